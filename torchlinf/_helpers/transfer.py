"""Trips between a device and the host's memory: one wait for all tensors there, none on the way back.

A copy into the memory of a program waits for the device, one by one. From and to page-locked memory CUDA copies by
itself: the host waits once, for the tensors that it needs, and goes on while the results travel back.
"""

import torch
from torch import Tensor


def to_host(*tensors: Tensor) -> tuple[Tensor, ...]:
    """The tensors, all of one device, on the CPU and without a gradient; those of the CPU are not copied.

    >>> to_host(torch.tensor([1.0, 2.0], requires_grad=True), torch.tensor(3))
    (tensor([1., 2.]), tensor(3))
    """
    device = tensors[0].device
    if not copies_by_itself(device):
        return tuple(x.detach().cpu() for x in tensors)
    copies = tuple(page_locked(x).copy_(x.detach(), non_blocking=True) for x in tensors)
    wait_for(device)
    return copies


def to_device(device: torch.device, *tensors: Tensor) -> tuple[Tensor, ...]:
    """Tensors of the CPU on a device; on CUDA they are on their way, and what is done with them there waits for them.

    >>> to_device(torch.device("cpu"), torch.tensor(3))
    (tensor(3),)
    """
    if not copies_by_itself(device):
        return tuple(x.to(device) for x in tensors)
    return tuple(page_locked(x).copy_(x).to(device, non_blocking=True) for x in tensors)


def float_of(device: torch.device) -> torch.dtype:
    """float64, or float32 on a device without it.

    >>> float_of(torch.device("cpu"))
    torch.float64
    """
    return torch.float32 if device.type == "mps" else torch.float64


def copies_by_itself(device: torch.device) -> bool:
    """Whether copies between a device and page-locked memory run beside the program."""
    return device.type == "cuda"


def page_locked(like: Tensor) -> Tensor:
    """Memory of the host for a tensor. PyTorch keeps it for the next trip, but not before a copy from it is done."""
    return torch.empty(like.shape, dtype=like.dtype, device="cpu", pin_memory=True)


def wait_for(device: torch.device) -> None:
    """Wait for what is queued on the present stream of a device, and for no other stream."""
    torch.cuda.current_stream(device).synchronize()
