"""Masks written as they were found: the format, the type, the values and the palette of the file that they are from."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torchlinf.scoring.atomic_write import replace_file
from torchlinf.scoring.names import suffix_of
from torchlinf.scoring.values import UnreadableMaskError

WRITTEN = (".png", ".bmp", ".tif", ".tiff", ".npy")
GEO_TAGS = (33550, 33922, 34264, 34735, 34736, 34737, 42112, 42113)  # where a GeoTIFF lies, and its nodata value
COLOUR_MAP = 320
KEPT = ("transparency", "dpi", "icc_profile")  # of what Pillow knows of an image
SHALLOW = (2, 4)  # bits of grey that Pillow reads as eight


class PixelFile:
    """The pixels of a file, as they are stored, and what else is needed to write others in their place.

    Attributes:
        pixels: (H, W), or (H, W, channels).
    """

    def __init__(self, path: Path) -> None:
        """Read the file, which has been read as a mask already: its size has been judged.

        Raises:
            UnreadableMaskError: no file of its kind is written.
        """
        self._suffix = suffix_of(path)
        if self._suffix not in WRITTEN:
            raise UnreadableMaskError(
                f"no {self._suffix or 'such'} file is written, only {', '.join(WRITTEN)}; convert it"
            )
        if self._suffix == ".npy":
            self.pixels: NDArray[Any] = np.load(path, allow_pickle=False)
        elif self._suffix in (".tif", ".tiff"):
            self._read_tiff(path)
        else:
            self._read_image(path)

    def write(self, path: Path, pixels: NDArray[Any]) -> None:
        """Write pixels to a file of the same kind, whole or not at all.

        Raises:
            OSError: it cannot be written.
        """
        replace_file(path, lambda temporary: self._write(temporary, pixels))

    def _read_image(self, path: Path) -> None:
        from PIL import Image

        with path.open("rb") as file:
            header = file.read(26)
        with Image.open(path) as image:
            if image.format not in ("PNG", "BMP"):
                raise UnreadableMaskError(f"its name says {self._suffix}, but it is {image.format}; convert it")
            if image.format == "PNG" and header[25] == 0 and header[24] in SHALLOW:
                raise UnreadableMaskError(f"no PNG of {header[24]} bits of grey is written; save it with 8 bits")
            self.pixels = np.array(image)
            self._format = image.format
            self._palette = image.getpalette("RGB") if image.mode == "P" else None
            self._info: dict[str, Any] = {str(name): image.info[name] for name in KEPT if name in image.info}

    def _read_tiff(self, path: Path) -> None:
        import tifffile

        with tifffile.TiffFile(path) as tiff:
            page: Any = tiff.pages[0]
            if len(tiff.pages) > 1:
                raise UnreadableMaskError("no TIFF of several pages is written; pass its pages one by one")
            self.pixels = page.asarray()
            tags = [page.tags[code] for code in GEO_TAGS if code in page.tags]
            resolution = [page.tags[name].value for name in ("XResolution", "YResolution") if name in page.tags]
            self._tiff: dict[str, Any] = {
                "photometric": page.photometric,
                "compression": None if page.compression == 1 else "zlib",
                "extratags": [(tag.code, tag.dtype, tag.count, tag.value, True) for tag in tags],
                "colormap": page.tags[COLOUR_MAP].value if COLOUR_MAP in page.tags else None,
                "metadata": None,
            }
            if len(resolution) == 2:
                self._tiff |= {"resolution": tuple(resolution), "resolutionunit": page.tags["ResolutionUnit"].value}

    def _write(self, path: Path, pixels: NDArray[Any]) -> None:
        if self._suffix == ".npy":
            with path.open("wb") as file:
                np.save(file, pixels)
        elif self._suffix in (".tif", ".tiff"):
            import tifffile

            tifffile.imwrite(path, pixels, **self._tiff)
        else:
            from PIL import Image

            image = Image.fromarray(pixels)
            if self._palette is not None:
                image = Image.fromarray(pixels, "P")
                image.putpalette(self._palette, "RGB")
            image.save(path, format=self._format, **self._info)
