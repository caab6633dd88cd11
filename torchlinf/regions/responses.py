"""What a classifier answers on a grid, as one mask for each class."""

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any, TypedDict

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from torchlinf._helpers.checks import choice, count, number_or_none
from torchlinf.regions.grids import Grid, Stack

RESPONSES = ("auto", "predict", "decision_function", "predict_proba")
SCORES = ("decision_function", "predict_proba", "predict")  # in the order in which "auto" looks for them, to threshold
CHUNK_POINTS = 1 << 14  # points asked for at a time, unless they have very many features:
CHUNK_NUMBERS = 1 << 22  # features of all points of a chunk, 32 MiB


class ResponseOptions(TypedDict):
    """How the responses of a classifier are asked for and become classes; arguments of all entry points."""

    response_method: str
    threshold: float | None
    classes: Sequence[Any] | None
    chunk_size: int | None


@dataclass(frozen=True)
class Responder:
    """How to ask a classifier.

    Attributes:
        ask: from points, float64 (P, *features), to a response.
        classes: what it calls its classes, if that is known.
        labels: whether the response are labels of classes, whatever their dtype.
        threshold: of a response with one number a point, if it has a natural one.
    """

    ask: Callable[[Tensor], Any]
    classes: tuple[Any, ...] | None = None
    labels: bool = False
    threshold: float | None = None


def class_masks(
    classifier: Any,
    grid: Grid | Stack,
    *,
    response_method: str = "auto",
    threshold: float | None = None,
    classes: Sequence[Any] | None = None,
    chunk_size: int | None = None,
) -> tuple[Tensor, tuple[Any, ...]]:
    """Where on the grid each class is, bool (C, *grid.shape), and the names of the classes.

    Example:
        >>> grid = Grid.within([(-1, 1)], 5)
        >>> class_masks(lambda points: points[:, 0], grid, threshold=0.2)
        (tensor([[ True,  True,  True, False, False],
                [False, False, False,  True,  True]]), (0, 1))
    """
    threshold = number_or_none(threshold, "threshold")
    responder = _responder(classifier, response_method, threshold)
    names = responder.classes if classes is None else _names(classes)
    renamed = None
    if responder.labels and not set(responder.classes or ()) <= set(names or ()):
        # Names in the order of the classes of the estimator, which answers in its own words.
        names, renamed = responder.classes, _as_many(names or (), responder.classes or ())
    with _evaluating(classifier):
        parts = [
            _reduce(response, names, threshold, responder) for response in _in_chunks(responder.ask, grid, chunk_size)
        ]
    answers = np.concatenate(parts)
    if answers.ndim == 1:
        masks, names = _split(answers, names)
    else:
        masks, names = answers.T, names or tuple(range(answers.shape[1]))
    names = names if renamed is None else renamed
    return torch.from_numpy(np.ascontiguousarray(masks)).reshape(len(names), *grid.shape), names


def _names(classes: Sequence[Any]) -> tuple[Any, ...]:
    """The names of the classes, each once."""
    if isinstance(classes, str) or not hasattr(classes, "__iter__"):
        raise TypeError(f"classes must be a sequence of names; got {classes!r}. Pass for example ['cat', 'dog'].")
    names = tuple(classes)
    if len(set(names)) < len(names):
        raise ValueError(f"classes must differ from each other; got {list(names)}. Name each class once.")
    return names


def _as_many(names: tuple[Any, ...], known: tuple[Any, ...]) -> tuple[Any, ...]:
    if len(names) != len(known):
        raise ValueError(
            f"classes must name the {len(known)} classes of the classifier, {list(known)}; got {list(names)}. "
            "Pass as many names, in that order."
        )
    return names


def _responder(classifier: Any, response_method: str, threshold: float | None) -> Responder:
    choice(response_method, RESPONSES, "response_method")
    if not isinstance(classifier, nn.Module) and hasattr(classifier, "predict"):
        return _of_estimator(classifier, response_method, threshold)
    if response_method != "auto":
        raise ValueError(
            "response_method chooses among the methods of a scikit-learn estimator; got "
            f"{response_method!r} beside a {type(classifier).__name__}. Leave it out."
        )
    if isinstance(classifier, nn.Module):
        known = next((p for p in classifier.parameters() if p.is_floating_point()), torch.empty(0, device="cpu"))
        return Responder(lambda points: classifier(points.to(known)))
    if not callable(classifier):
        raise TypeError(
            "classifier must be a torch.nn.Module, a scikit-learn estimator or a callable; got "
            f"{type(classifier).__name__}. Pass a function from points (P, features) to responses."
        )
    return Responder(lambda points: classifier(points.to(torch.get_default_dtype())))


def _of_estimator(estimator: Any, response_method: str, threshold: float | None) -> Responder:
    # Scores need not lead to what the estimator predicts: SVC may score pairs of classes, and thresholds may be tuned.
    auto = ("predict",) if threshold is None else SCORES
    methods = auto if response_method == "auto" else (response_method,)
    name = next((method for method in methods if hasattr(estimator, method)), None)
    if name is None:
        raise ValueError(
            f"response_method must be a method of the classifier; got {response_method!r}, which "
            f'{type(estimator).__name__} has not. Pass response_method="auto".'
        )
    known = getattr(estimator, "classes_", None)
    if isinstance(known, list) or getattr(estimator, "multilabel_", False) is True:
        raise _several_answers(estimator)
    if name == "decision_function" and known is not None and len(known) > 2 and _scores_pairs(estimator):
        raise ValueError(
            'response_method="decision_function" needs one score for each class; got an estimator with '
            'decision_function_shape="ovo", which scores pairs of classes. Pass response_method="predict".'
        )
    classes = None if known is None else tuple(np.asarray(known).tolist())
    method = getattr(estimator, name)

    def ask(points: Tensor) -> Any:
        inputs = _inputs(estimator, points)
        labels = np.asarray(estimator.predict(inputs[:1]))
        # A scikit-learn estimator has get_params. Other objects may call the method that gives scores `predict`.
        if (
            labels.ndim > 1
            and math.prod(labels.shape[1:]) > 1
            and (labels.dtype.kind != "f" or hasattr(estimator, "get_params"))
        ):
            raise _several_answers(estimator)
        return method(inputs)

    return Responder(
        ask,
        classes,
        labels=name == "predict" and classes is not None,
        threshold=0.0 if name == "decision_function" else None,
    )


def _several_answers(estimator: Any) -> ValueError:
    return ValueError(
        f"classifier must predict one class for each point; got {type(estimator).__name__}, which predicts several "
        "outputs or labels. Pass a function that selects one of them, such as lambda points: model.predict(points)[:, "
        "0]."
    )


def _scores_pairs(estimator: Any) -> bool:
    """Whether the decision function has a score for each pair of classes, also in a pipeline or behind a search."""
    fitted = [estimator, getattr(estimator, "best_estimator_", None)]
    return any(
        name.split("__")[-1] == "decision_function_shape" and value == "ovo"
        for one in fitted
        if hasattr(one, "get_params")
        for name, value in one.get_params().items()
    )


def _inputs(estimator: Any, points: Tensor) -> Any:
    """The points as what the estimator was fitted on: a table with named columns, or an array."""
    names = getattr(estimator, "feature_names_in_", None)
    array = points.numpy()
    if names is None or array.ndim != 2 or len(names) != array.shape[1] or find_spec("pandas") is None:
        return array
    import pandas

    return pandas.DataFrame(array, columns=names)


@contextmanager
def _evaluating(classifier: Any) -> Iterator[None]:
    """A module in evaluation mode, every part of it in its own mode again afterwards; no gradients for anything."""
    modes = [(part, part.training) for part in classifier.modules()] if isinstance(classifier, nn.Module) else []
    try:
        for part, _ in modes:
            part.training = False
        with torch.no_grad():
            yield
    finally:
        for part, training in modes:
            part.training = training


def _in_chunks(ask: Callable[[Tensor], Any], grid: Grid | Stack, chunk_size: int | None) -> Iterator[NDArray[Any]]:
    """The responses (P,) or (P, C), free of NaN."""
    total = math.prod(grid.shape)
    features = grid.points(0, 1).numel()
    step = (
        min(CHUNK_POINTS, max(1, CHUNK_NUMBERS // features)) if chunk_size is None else count(chunk_size, "chunk_size")
    )
    for start in range(0, total, step):
        points = grid.points(start, min(start + step, total))
        yield _checked(ask(points), points)


def _checked(response: Any, points: Tensor) -> NDArray[Any]:
    if isinstance(response, Tensor):
        response = (response.float() if response.dtype == torch.bfloat16 else response).numpy(force=True)
    answers = np.asarray(response)
    if answers.ndim == 2 and answers.shape[1] == 1:
        answers = answers[:, 0]
    if answers.ndim not in (1, 2) or len(answers) != len(points) or 0 in answers.shape:
        raise ValueError(
            f"classifier must answer ({len(points)},) or ({len(points)}, classes) for {len(points)} points; got "
            f"{type(response).__name__} of shape {answers.shape}. Pass a function that selects and reshapes its output."
        )
    if answers.dtype.kind == "f":
        bad = np.isnan(answers).reshape(len(answers), -1).any(axis=1)
        if bad.any():
            where = ", ".join(f"{x:.4g}" for x in points[int(bad.argmax())].flatten()[:4].tolist())
            raise ValueError(
                f"classifier must answer without NaN; got NaN at {bad.sum()} of {len(points)} points, the first at "
                f"({where}{', ...' if points[0].numel() > 4 else ''}). Train it anew, or choose bounds within which it "
                "is defined."
            )
    return answers


def _reduce(
    response: NDArray[Any], names: tuple[Any, ...] | None, threshold: float | None, responder: Responder
) -> NDArray[Any]:
    """Labels (P,), or masks (P, C)."""
    if response.ndim == 1:
        if responder.labels or response.dtype.kind not in "f":
            return response
        threshold = responder.threshold if threshold is None else threshold
        if threshold is None:
            raise ValueError(
                "threshold must be a number where the classifier answers one number a point; got None. "
                "Pass threshold=0.0 for logits, threshold=0.5 for probabilities."
            )
        above = response > threshold
        return np.stack([~above, above], axis=1)
    if threshold is None and response.dtype.kind in "biu":
        _require_one_class(response)
    if names is not None and len(names) != response.shape[1]:
        raise ValueError(
            f"classifier must answer one number for each of its {len(names)} classes; got {response.shape[1]}. "
            'Pass response_method="predict", or classes=... with as many names.'
        )
    return response > threshold if threshold is not None else _largest(response)


def _require_one_class(response: NDArray[Any]) -> None:
    """Raise for rows of 0 and 1 that mark several classes, or none: they are labels, not scores."""
    if bool(((response == 0) | (response == 1)).all()):
        marked = response.sum(axis=1)
        if bool((marked != 1).any()):
            wrong = int(marked[marked != 1][0])
            raise ValueError(
                f"classifier must give each point one class; got a row with {wrong} of {response.shape[1]} labels. "
                "Pass threshold=0.5, which measures the region of each label alone."
            )


def _largest(response: NDArray[Any]) -> NDArray[np.bool_]:
    """The class of the largest number, the first of those that tie."""
    return np.arange(response.shape[1]) == response.argmax(axis=1)[:, None]


def _split(labels: NDArray[Any], names: tuple[Any, ...] | None) -> tuple[NDArray[np.bool_], tuple[Any, ...]]:
    """One mask for each class, (C, P)."""
    met, place = np.unique(labels, return_inverse=True)
    if names is None:
        names = tuple(met.tolist())
    unknown = [label for label in met.tolist() if label not in names]
    if unknown:
        raise ValueError(
            f"classes must hold every label that the classifier answers; got {list(names)} without {unknown[0]!r}. "
            "Leave classes out to take those that are met."
        )
    number = np.array([names.index(label) for label in met.tolist()])[place.reshape(-1)]
    return np.arange(len(names))[:, None] == number, names
