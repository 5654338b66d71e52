"""One set of colours for every picture: Okabe & Ito (2008), told apart with every kind of colour vision."""

BLACK = "#000000"
SKY = "#56B4E9"
GREEN = "#009E73"
BLUE = "#0072B2"
VERMILION = "#D55E00"
GREY = "#8C8C8C"

RIGID = VERMILION
FREE = BLUE
PIVOT = GREEN
AXES = (VERMILION, GREEN, BLUE)
"""x, y, z."""


def bgr(colour: str) -> tuple[int, int, int]:
    """A colour as OpenCV's blue, green, red."""
    red, green, blue = bytes.fromhex(colour.removeprefix("#"))
    return blue, green, red
