"""Names: of the files that are read, and of the masks in them."""

import re
from itertools import count
from pathlib import Path, PurePath

NETPBM_SUFFIXES = (".pbm", ".pgm", ".ppm", ".pnm")
NIFTI_SUFFIXES = (".nii", ".nii.gz")
IMAGE_SUFFIXES = (".png", ".gif", ".tif", ".tiff", ".bmp", ".jpg", ".jpeg", ".webp", ".avif", *NETPBM_SUFFIXES)
ARRAY_SUFFIXES = (".npy", ".npz")
SUFFIXES = (*IMAGE_SUFFIXES, *ARRAY_SUFFIXES, *NIFTI_SUFFIXES)

TAR_SUFFIXES = (".tar", *(PACKED_SUFFIXES := (".tar.gz", ".tgz")))


def suffix_of(name: str | Path) -> str:
    """The suffix of a file in small letters; ".nii.gz", ".tar.gz" and the like in one.

    >>> suffix_of("a.b/C.NII.GZ"), suffix_of("c.tar"), suffix_of("c.2024.png"), suffix_of("none")
    ('.nii.gz', '.tar', '.png', '')
    """
    suffixes = [suffix.lower() for suffix in PurePath(name).suffixes]
    return "".join(suffixes[-2:] if suffixes[-1:] == [".gz"] else suffixes[-1:])


def name_beside(name: str, taken: set[str]) -> str:
    """A name that is not taken yet: the name itself, or with "~2" behind, "~3" and so on.

    >>> name_beside("a.png", {"b.png"}), name_beside("a.png", {"a.png", "a.png~2"})
    ('a.png', 'a.png~3')
    """
    return name if name not in taken else next(new for i in count(2) if (new := f"{name}~{i}") not in taken)


def split_name(name: str) -> tuple[str, int | None]:
    """The name of the source of a row that is named by a page, a label, an object or several of them; and the page.

    >>> split_name("stack.npy[3]#15@2"), split_name("map.png#7"), split_name("a.png")
    (('stack.npy', 3), ('map.png', None), ('a.png', None))
    """
    source = re.sub(r"(\[(\d+)\])?(#\d+)?(@\d+)?$", "", name, count=1)
    page = re.match(r"\[(\d+)\]", name[len(source) :])
    return source, None if page is None else int(page[1])
