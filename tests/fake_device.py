"""A stand-in for a device that is not the CPU: its tensors hold their values on the CPU, but say they are elsewhere.

Inside `FakeDevice()`, tensors on `DEVICE` can be made, computed with and differentiated. As on a GPU their values can
not be read without a copy to the CPU. It counts what a GPU would make the host wait for: copies either way, numbers and
truth values taken from tensors, and operations whose result has a size that depends on values. Copies from and to
page-locked memory that need not be waited for are counted apart.
"""

from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor
from torch.overrides import TorchFunctionMode
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_leaves, tree_map_only

DEVICE = torch.device("lazy")  # a device type of torch for which nothing is registered here

# Operations that look at values on the device to know the size of their result, or to give it to the program.
READS = {
    "aten::_local_scalar_dense", "aten::equal", "aten::nonzero", "aten::masked_select", "aten::_unique2",
    "aten::unique_dim", "aten::unique_consecutive", "aten::bincount", "aten::repeat_interleave",
}  # fmt: skip
INDEXES = {"aten::index", "aten::index_put", "aten::index_put_", "aten::_index_put_impl_"}


class Elsewhere(Tensor):
    """A tensor that says it is on `DEVICE`."""

    @staticmethod
    def __new__(cls, values: Tensor) -> "Elsewhere":
        one = Tensor._make_wrapper_subclass(
            cls, values.shape, strides=values.stride(), dtype=values.dtype, device=DEVICE, requires_grad=False
        )
        one.values_held = values
        return one

    @classmethod
    def __torch_function__(cls, func: Callable, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        with torch._C.DisableTorchFunctionSubclass():
            if func is Tensor.data_ptr:
                return args[0].values_held.data_ptr()
            # Torch has these for its own tensors only. On a device they copy to the CPU first.
            if func is Tensor.tolist:
                return args[0].detach().cpu().tolist()
            if func is Tensor.numpy:
                if not (kwargs or {}).get("force"):
                    raise TypeError(f"can't convert {DEVICE.type} device type tensor to numpy. Use Tensor.cpu().")
                return args[0].detach().cpu().numpy()
            return func(*args, **(kwargs or {}))

    @classmethod
    def __torch_dispatch__(cls, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        raise AssertionError(f"{func} was called outside of FakeDevice()")


class _Constants(TorchFunctionMode):
    """`torch.tensor(numbers, device=...)` makes the tensor on the CPU and copies it."""

    def __torch_function__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        kwargs = kwargs or {}
        if func in (torch.tensor, torch.as_tensor) and _elsewhere(kwargs.get("device")):
            return func(*args, **{**kwargs, "device": "cpu"}).to(DEVICE)
        return func(*args, **kwargs)


class FakeDevice(TorchDispatchMode):
    """Runs what is done with tensors on `DEVICE`, and counts.

    Attributes:
        waits: the names of the operations that a device would make the host wait for.
        copies: how many copies there were that it need not wait for.
        locked: storages of the page-locked memory, which `page_locked` adds to.
    """

    def __init__(self) -> None:
        super().__init__()
        self.waits: list[str] = []
        self.copies = 0
        self.locked: list[Tensor] = []
        self._constants = _Constants()

    def __enter__(self) -> "FakeDevice":
        self._constants.__enter__()
        super().__enter__()
        return self

    def __exit__(self, *error: Any) -> None:
        super().__exit__(*error)
        self._constants.__exit__(*error)

    def put(self, values: Tensor) -> Tensor:
        """A tensor on the device; the copy is not counted."""
        return Elsewhere(values.detach().clone())

    def page_locked(self, like: Tensor) -> Tensor:
        """Memory of the CPU that copies need not be waited for."""
        found = torch.empty(like.shape, dtype=like.dtype, device="cpu")
        self.locked.append(found)
        return found

    def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        kwargs = dict(kwargs or {})
        name = func.name().partition(".")[0]
        there = any(isinstance(x, Elsewhere) for x in tree_leaves((args, kwargs)))
        target = there
        if "device" in kwargs and kwargs["device"] is not None:
            target = _elsewhere(kwargs["device"])
            kwargs["device"] = "cpu"
        if name == "aten::copy_":
            self._copy(name, args[1], args[0], args[2] if len(args) > 2 else kwargs.get("non_blocking", False))
        elif name == "aten::_to_copy":
            self._copy(name, args[0], target, kwargs.get("non_blocking", False))
        elif there and name in READS:
            self.waits.append(name)
        elif name in INDEXES and isinstance(args[0], Elsewhere):
            indices = [index for index in args[1] if index is not None]
            if any(index.dtype == torch.bool or not isinstance(index, Elsewhere) for index in indices):
                self.waits.append(name)
        elif there:
            alien = [x for x in tree_leaves((args, kwargs)) if type(x) is Tensor and x.ndim > 0]
            assert not alien, f"{name} was given tensors of the CPU beside tensors on the device"
        # A copy within the CPU would be a view of the same values.
        if name == "aten::_to_copy":
            kwargs["copy"] = True
            func, kwargs = torch.Tensor.to, {k: v for k, v in kwargs.items() if k in ("device", "dtype", "copy")}
        inner = tree_map_only(Elsewhere, lambda x: x.values_held, (args, kwargs))
        result = func(*inner[0], **inner[1])
        if name.endswith("_") and isinstance(args[0], Tensor):
            return args[0]  # changed in place
        return tree_map_only(Tensor, Elsewhere, result) if target else result

    def _copy(self, name: str, source: Tensor, target: Any, non_blocking: bool) -> None:
        onto = isinstance(target, Elsewhere) if isinstance(target, Tensor) else target
        if isinstance(source, Elsewhere) == onto:
            return
        on_cpu = source if onto else target
        locked = isinstance(on_cpu, Tensor) and any(on_cpu.data_ptr() == one.data_ptr() for one in self.locked)
        if non_blocking and locked:
            self.copies += 1
        else:
            self.waits.append(name)


def _elsewhere(device: Any) -> bool:
    return device is not None and torch.device(device).type == DEVICE.type
