"""The fit on a photo of a real person: the astronaut that scikit-image ships, with points that are kept here."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

from evalkit.head import load_head
from evalkit.head.check import check_head
from evalkit.head.fitting import fit_head
from evalkit.head.photo import read_photo
from evalkit.head.points import Points

PLACES = {
    "forehead": (226, 72), "nasion": (225, 101), "nose tip": (224, 127),
    "subnasale": (223, 133), "upper lip": (223, 141), "lower lip": (223, 155),
    "chin": (221, 177), "brow inner left": (236, 91), "brow inner right": (215, 90),
    "brow middle left": (254, 90), "brow middle right": (198, 87), "brow outer left": (264, 95),
    "brow outer right": (188, 91), "eye inner left": (236, 105), "eye inner right": (214, 104),
    "upper lid inner left": (244, 100), "upper lid inner right": (206, 98), "upper lid outer left": (251, 101),
    "upper lid outer right": (199, 98), "eye outer left": (255, 104), "eye outer right": (195, 101),
    "lower lid outer left": (249, 106), "lower lid outer right": (201, 104), "lower lid inner left": (242, 106),
    "lower lid inner right": (208, 104), "nose wing left": (236, 131), "nose wing right": (211, 129),
    "lip peak left": (230, 140), "lip peak right": (217, 139), "mouth corner left": (244, 141),
    "mouth corner right": (202, 139), "jaw left": (261, 153), "jaw right": (185, 149),
    "ear left": (270, 106), "ear right": (181, 101), "upper lip inner": (223, 143),
    "lower lip inner": (223, 149), "pupil left": (246, 104), "pupil right": (203, 101),
}  # fmt: skip
"""Found by the face detector, to a pixel, and looked at."""


def test_the_astronaut_is_fitted_and_wears_her_photo(tmp_path):
    data = pytest.importorskip("skimage.data", reason="pip install evalkit[test]")
    Image.fromarray(data.astronaut()).save(tmp_path / "astronaut.png")
    photo = read_photo(tmp_path / "astronaut.png")
    head, report = fit_head(
        photo, Points({name: np.array(at, float) for name, at in PLACES.items()}), load_head(vertices=2500)
    )
    # The requirement for points that are given.
    assert report.reprojection_rms_px <= 0.5 and report.relaxed == 0.0
    assert check_head(head) == []
    # She smiles, and her eyes are 43 pixels apart.
    assert {"mouth open", "small"} <= set(report.status)
    # Skin that faces the camera wears the colour that the photo has there, and the built-in head's own does not. The
    # chin looks down and is blended with what is beside it.
    generic = load_head(vertices=2500)
    for head_worn, same in ((head, True), (generic, False)):
        off = [colour_off(head_worn, name, photo) for name in ("forehead", "nasion", "nose tip", "subnasale")]
        assert (max(off) < LIKE) == same, off


LIKE = 25.0
"""Of 255: skin a few pixels beside a point, which is as far as vertices are apart, differs by some ten."""


def colour_off(head, name, photo):
    """How far the colour of the skin at a landmark is from that of the photo at its point, of 255."""
    height, width = head.texture.shape[:2]
    u, v = head.uv[head.nearest_vertices(head.landmarks)[name]]
    worn = head.texture[int((1.0 - v) * height), int(u * width), :3].astype(float)
    x, y = PLACES[name]
    return float(np.abs(worn - photo.pixels[y - 1 : y + 2, x - 1 : x + 2].mean(axis=(0, 1))).max())
