"""One set of colours for every picture: Okabe & Ito (2008), told apart with every kind of colour vision."""

BLACK = "#000000"
ORANGE = "#E69F00"
SKY = "#56B4E9"
GREEN = "#009E73"
BLUE = "#0072B2"
VERMILION = "#D55E00"
PURPLE = "#CC79A7"
GREY = "#8C8C8C"

RIGID = VERMILION
FREE = BLUE
BEFORE = GREY
AFTER = BLUE
PIVOT = GREEN
AXES = (VERMILION, GREEN, BLUE)
"""x, y, z."""
