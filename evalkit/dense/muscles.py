"""Muscles for a head that has none of its own: skin is drawn along its surface towards where a muscle is fixed.

A linear muscle draws the skin at its insertion towards its attachment, and the skin around it the less the further
away it is over the surface, as in Waters' model [1]_. Distance is over the surface, so that a muscle of one lip does
not move the other across the slit; muscles at the corners of the mouth move both lips, as if they were sewn together.
The mouth's ring muscle narrows the lips and pushes them forward. Directions and lengths follow the expression shapes
of ICT-FaceKit at the marker sites, as in :mod:`evalkit.synthetic.expression`.

References
----------
.. [1] K. Waters, "A muscle model for animating three-dimensional facial expression", SIGGRAPH 1987,
   doi:10.1145/37401.37405.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from evalkit.deform.surface import edge_distance, edge_graph
from evalkit.dense.face import Face, Turn, about_x
from evalkit.dense.mouth import lip_contact
from evalkit.errors import EvalkitError
from evalkit.geometry import Array
from evalkit.head import Head
from evalkit.head.model import SOFT
from evalkit.synthetic.expression import JAW_DEG, JAW_GLIDE

SIDES = {"left": "L", "right": "R"}
"""Side in the name of a landmark, and in that of a marker site."""

SMOOTH_MM = 3.0
"""Paths along edges have kinks where they change direction; fields are averaged over so much skin."""

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Muscle:
    """A linear muscle of the left side; the right side mirrors it.

    Attributes
    ----------
    unit : str
        The unit that it works in.
    insertion : str
        Landmark or marker site on the skin, without its side.
    attachment : (float, float, float)
        Where it is fixed, relative to the insertion, mm; further away than the reach.
    pull_mm : float
        How far the skin at the insertion goes at full strength.
    reach_mm : float
        Distance over the surface beyond which it moves nothing.
    both_lips : bool
        Whether it moves the lips as one.
    """

    unit: str
    insertion: str
    attachment: Vector
    pull_mm: float
    reach_mm: float
    both_lips: bool = False


MUSCLES = (
    Muscle("smile", "mouth corner", (26, 46, -26), 13.0, 38, both_lips=True),  # zygomaticus major
    Muscle("smile", "Cheek", (12, 38, 22), 5.0, 28),  # the cheek is pushed up and out by what comes from below
    Muscle("smile", "nose wing", (14, 14, -8), 2.5, 14),
    Muscle("lip_stretch", "mouth corner", (36, -10, -28), 7.0, 30, both_lips=True),  # risorius
    Muscle("upper_lip_up", "lip peak", (3, 36, -6), 3.5, 27),  # levator labii superioris
    Muscle("upper_lip_up", "nose wing", (8, 24, -6), 2.0, 14),
    Muscle("lower_lip_down", "LowerLip", (4, -36, -7), 3.5, 28),  # depressor labii inferioris
    Muscle("brow_up", "brow inner", (2, 40, -6), 4.5, 28),  # frontalis
    Muscle("brow_up", "BrowOut", (9, 40, -12), 6.5, 30),
    Muscle("brow_down", "brow inner", (-20, -26, 9), 3.0, 24),  # corrugator, procerus
    Muscle("brow_down", "brow middle", (-26, -22, 15), 5.5, 26),
)
"""The size of each gradient, about ``pi / 2 * pull / reach``, is below 1: no muscle by itself folds the skin over."""

RING_REACH_MM = 26.0
NARROW, EVERT = 0.22, 0.05
FORWARD_MM = (5.0, 3.0)
"""Ring muscle of the mouth at full strength: share of their distance from the middle by which the lips come in, and
by which they part in height; how far they come forward in the middle, and how much more at the corners."""


def muscle_face(head: Head) -> Face:
    """A head with muscles, its jaw and its lids.

    Parameters
    ----------
    head : Head
        With the landmarks and marker sites of the template.

    Returns
    -------
    Face

    Raises
    ------
    EvalkitError
        If a landmark is missing.
    """
    skin = _Skin(head)
    fields: dict[str, Array] = {}
    for muscle in MUSCLES:
        for side in SIDES:
            unit = f"{muscle.unit} {side}"
            fields[unit] = fields.get(unit, 0.0) + skin.pulled(muscle, side)
    fields["pucker"] = skin.puckered()
    turns = {}
    if head.lids is not None:
        turns["lid_down"] = lid_turn(head)
    if head.jaw is not None:
        turns["jaw"] = jaw_turn(head)
    return Face(head, fields, turns)


def jaw_turn(head: Head) -> Turn:
    """The jaw about its hinge, by the head's own shares, with the glide of the condyles."""
    assert head.jaw is not None
    which = np.flatnonzero(head.jaw.weights)
    share = head.jaw.weights[which]
    angle = np.deg2rad(JAW_DEG) * share
    shift = about_x(share[:, None] * JAW_GLIDE, -angle)
    return Turn(which, np.broadcast_to(head.jaw.axis, (len(which), 3)), angle, shift)


def lid_turn(head: Head) -> Turn:
    """The upper lids along the eyeballs, as :meth:`Head.posed` closes them."""
    lids = head.lids
    assert lids is not None
    which = np.flatnonzero(lids.eye >= 0)
    centre = lids.centres[lids.eye[which]]
    arm = head.vertices[which] - centre
    shift = arm * (lids.lift[which] / np.linalg.norm(arm, axis=1))[:, None]
    return Turn(which, centre, lids.turn[which], shift)


class _Skin:
    """The soft surface of a head and distances over it, with the lips apart and sewn together."""

    def __init__(self, head: Head) -> None:
        self.head = head
        self.apart = edge_graph(head.vertices, head.part_triangles(*SOFT))
        self.contact = contact = lip_contact(head)
        lower, upper = np.repeat(contact.lower, 2), contact.upper.ravel()
        gap = np.linalg.norm(head.vertices[lower] - head.vertices[upper], axis=1)
        seam = sp.coo_array((np.maximum(gap, 1e-6), (lower, upper)), shape=self.apart.shape).tocsr()
        self.sewn = self.apart + seam + seam.T
        follow = np.zeros(len(head.vertices))
        if head.lids is not None:
            follow = np.abs(head.lids.turn) / max(float(np.abs(head.lids.turn).max()), 1e-12)
        self.free = 1.0 - follow  # lids slide on the eyeballs, whatever the brows do

    def pulled(self, muscle: Muscle, side: str) -> Array:
        """Displacement (V, 3) by one muscle at full strength."""
        place = self._place(muscle.insertion, side)
        mirror = np.array([1.0 if side == "left" else -1.0, 1.0, 1.0])
        vertex = next(iter(self.head.nearest_vertices({"insertion": place}).values()))
        strength = self._fading([vertex], muscle.reach_mm, muscle.both_lips)
        towards = place + mirror * muscle.attachment - self.head.vertices
        towards /= np.linalg.norm(towards, axis=1)[:, None]
        return np.asarray(muscle.pull_mm * strength[:, None] * towards)

    def puckered(self) -> Array:
        """Displacement (V, 3) by the ring muscle of the mouth at full strength."""
        head = self.head
        middle = 0.5 * (self._place("mouth corner", "left") + self._place("mouth corner", "right"))
        half = float(np.abs(self._place("mouth corner", "left") - middle)[0])
        lips = np.concatenate([head.regions["upper lip"], head.regions["lower lip"]])
        strength = self._fading(np.intersect1d(lips, head.skin_vertices), RING_REACH_MM, both_lips=True)
        off = head.vertices - middle
        forward = FORWARD_MM[0] + FORWARD_MM[1] * np.minimum((off[:, 0] / half) ** 2, 1.5)
        move = np.stack([-NARROW * off[:, 0], EVERT * off[:, 1], forward], axis=1)
        return np.asarray(strength[:, None] * move)

    def _place(self, name: str, side: str) -> Array:
        for known, places in ((f"{name} {side}", self.head.landmarks), (name + SIDES[side], self.head.marker_sites)):
            if known in places:
                return np.asarray(places[known])
        raise EvalkitError(f"{self.head.name}: no landmark '{name} {side}'; its muscles cannot be placed")

    def _fading(self, sources: Array | list[int], reach_mm: float, both_lips: bool) -> Array:
        """``cos²(pi d / (2 reach))`` of the distance over the surface, averaged over `SMOOTH_MM`; shape (V,)."""
        graph = self.sewn if both_lips else self.apart
        distance = np.minimum(edge_distance(graph, sources), reach_mm)
        strength = np.cos(0.5 * np.pi * distance / reach_mm) ** 2
        neighbours = graph.astype(bool).astype(float)
        count = np.asarray(neighbours.sum(axis=1)).ravel()
        average = sp.diags_array(1.0 / np.maximum(count, 1.0)) @ neighbours
        edge = float(np.median(self.apart.data))
        # Half a step to the neighbours' mean spreads by a quarter of an edge squared along either axis.
        for _ in range(max(1, round(4.0 * (SMOOTH_MM / edge) ** 2))):
            strength = 0.5 * (strength + np.where(count > 0, average @ strength, strength))
            if both_lips:
                strength = self._joined(strength)
        return np.asarray(strength * self.free)

    def _joined(self, strength: Array) -> Array:
        """Strengths made equal where the lips touch, so that neither pushes into the other."""
        lower, upper, share = self.contact.lower, self.contact.upper, self.contact.share
        parts = np.stack([1.0 - share, share], axis=1)
        out, count = strength.copy(), len(strength)
        common = 0.5 * (strength[lower] + (parts * strength[upper]).sum(axis=1))
        weight = np.bincount(upper.ravel(), parts.ravel(), minlength=count)
        value = np.bincount(upper.ravel(), (parts * common[:, None]).ravel(), minlength=count)
        opposite = np.flatnonzero(weight)
        told = np.minimum(weight[opposite], 1.0)
        out[opposite] += told * (value[opposite] / weight[opposite] - strength[opposite])
        out[lower] = (parts * out[upper]).sum(axis=1)
        return out
