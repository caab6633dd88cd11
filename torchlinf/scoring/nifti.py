"""NIfTI images, .nii and .nii.gz: the numbers as they are stored, and the size of a voxel. Needs the extra `nifti`."""

import gzip
import zlib
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from torchlinf._helpers.extras import require
from torchlinf.scoring.values import UnreadableMaskError, Values, require_size

GZIP = b"\x1f\x8b"
HEADER = 348  # bytes of the first version's header; that of the second has 540


def is_nifti(file: IO[bytes]) -> bool:
    """Whether a file begins as a NIfTI image does, plain or compressed by gzip; the file is at its start afterwards."""
    return _version(file) is not None


def read_nifti(file: IO[bytes], max_pixels: int) -> Values:
    """Read a NIfTI image of either version and byte order.

    Args:
        file: at its start; may be compressed by gzip.
        max_pixels: what holds more numbers than this is refused.

    Returns:
        The numbers, (D, H, W): slices, rows, columns, which are the third, second and first axis of the file. Axes of
        one voxel are dropped while there are more than two. Several volumes are (N, D, H, W). Integers stay integers
        where the header does not scale them.

    Raises:
        UnreadableMaskError: nibabel is not installed, or the file is none, too large, or of colours or complex numbers.
    """
    try:
        nibabel: Any = require("nibabel", "reading NIfTI", "nifti")
        volumeutils: Any = require("nibabel.volumeutils", "reading NIfTI", "nifti")
    except ImportError as error:
        raise UnreadableMaskError(str(error)) from error
    version = _version(file)
    if version is None:
        raise UnreadableMaskError("not a NIfTI image in one file (.nii, .nii.gz), or a damaged one")
    plain: Any = gzip.GzipFile(fileobj=file) if _is_packed(file) else file
    # Unchecked: the checks of nibabel print warnings on standard error.
    header = (nibabel.Nifti1Header if version == 1 else nibabel.Nifti2Header).from_fileobj(plain, check=False)
    dtype, shape = header.get_data_dtype(), tuple(int(size) for size in header.get_data_shape())
    if dtype.kind not in "iuf":
        what = "colours" if dtype.kind == "V" else "complex numbers" if dtype.kind == "c" else str(dtype)
        raise UnreadableMaskError(f"a mask must be integer or floating point; got {what}. Save one number a voxel")
    if not shape or min(shape) < 1:
        raise UnreadableMaskError(f"a mask must hold voxels; got shape {shape}")
    require_size(shape, max_pixels)
    stored = volumeutils.array_from_file(shape, dtype, plain, header.get_data_offset(), mmap=False)
    return _values(_scaled(stored, *header.get_slope_inter()), header["pixdim"][1:4])


def _is_packed(file: IO[bytes]) -> bool:
    beginning = file.read(2)
    file.seek(0)
    return beginning == GZIP


def _version(file: IO[bytes]) -> int | None:
    try:
        header = gzip.GzipFile(fileobj=file).read(HEADER) if _is_packed(file) else file.read(HEADER)
    except (OSError, EOFError, zlib.error):
        header = b""
    file.seek(0)
    if header[344:348] == b"n+1\0":
        return 1
    return 2 if header[4:8] == b"n+2\0" else None


def _scaled(stored: NDArray[Any], slope: float | None, intercept: float | None) -> NDArray[Any]:
    """The numbers that are meant: as they are stored, unless the header says otherwise."""
    if slope is None or (slope == 1 and not intercept):
        native: NDArray[Any] = stored.astype(stored.dtype.newbyteorder("="), copy=False)
        # An extended float has no place in the tables of values.
        return native.astype(np.float64) if native.dtype.kind == "f" and native.dtype.itemsize > 8 else native
    return stored.astype(np.float64) * slope + (intercept or 0.0)


def _values(array: NDArray[Any], sizes: NDArray[Any]) -> Values:
    axes = array.shape + (1,) * (3 - array.ndim)
    volumes = np.asarray(array).reshape(*axes[:3], -1, order="F").T  # (N, D, H, W)
    shape = volumes.shape[1:]
    kept = [axis for axis in range(3) if shape[axis] > 1]
    kept = sorted(kept + [axis for axis in (2, 1, 0) if axis not in kept][: max(2 - len(kept), 0)])
    # The header has 32 bits: 0.9, not 0.89999998.
    spacing = tuple(float(str(sizes[2 - axis])) for axis in kept)
    whole = volumes.reshape(len(volumes), *(shape[axis] for axis in kept))
    return Values(
        whole[0] if len(whole) == 1 else whole,
        spatial_ndim=len(kept),
        spacing=spacing if all(0 < size < np.inf for size in spacing) else None,
        is_to_scale=True,
    )
