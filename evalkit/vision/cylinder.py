"""The cylinder tracker: head pose by registering a textured surface to every frame.

After Xiao, Moriyama, Kanade & Cohn (2003), doi:10.1002/ima.10048, as Chai, Xiao & Hodgins (2003) use it: a cylinder
from 19 points, Gauss-Newton with robust weights from coarse to fine, a template that is updated, and stored references
against drift. Changed here: pictures are normalised by their local contrast, weights follow the local correlation (an
occluder is found as an area), every pose is judged against the references, and a lost head is looked for.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import cv2
import numpy as np

from evalkit.geometry import Array, nearest_rotation, rotation_angle, rotation_from_vector, rotation_vector
from evalkit.vision.camera import Camera
from evalkit.vision.initial import Start, mean_face_surface, start_from_points
from evalkit.vision.points import FACE_POINTS
from evalkit.vision.references import Reference, distances_deg, make_reference, search, towards
from evalkit.vision.registration import Fit, Template, Texture, View, judge, register, sharpness
from evalkit.vision.relief import KEY_DEG, MOST_KEYS, WIDEST_DEG, Relief
from evalkit.vision.surface import Map, Surface
from evalkit.vision.tracker import LOST, HeadPose, Picture, TrackStatus

TRACKED_SCORE = 0.55
LOST_SCORE = 0.45
"""Scores (see :class:`evalkit.vision.registration.Fit`) from which a pose is tracked, and below which it is none."""

CLOSED_SCORE = 0.7
"""Below this, references that seem far are tried, too."""

SHARP = 0.38
"""Sharpness (:func:`evalkit.vision.registration.sharpness`) that the first frame must have, or all that follows is
weak: a smear looks like itself from frame to frame, whatever is beneath. Faces filmed at 90 x 72 pixels have 0.41 and
more, at H.264's coarsest 0.42, sharp ones 0.44 to 0.8; blurred by a fortieth of the face's width 0.33."""

SMEARED = 0.7
"""Share of the first frame's sharpness below which a frame is weak. Turns and motion blur leave 0.78 and more."""

ALONE_SCORE = 0.62
"""What a pose must reach that is far from all references after a frame that was unsure: a hand that is followed has
0.58 to 0.61."""

LONGEST_WEAK = 15
"""Frames after which a pose that stays weak is taken for none."""

FOUND_SCORE = 0.6
"""A head that was lost is back when a pose reaches this."""

NEAR_DEG = 20.0
"""A reference is used up to this far from its pose."""

NEW_DEG = 14.0
NEW_SCORE = 0.65
"""A pose becomes a reference when it is so far from all others and reaches this score."""

MOST_REFERENCES = 40
"""Enough for all poses of a face in steps of 14 degrees, at two distances."""

USUAL_SCORE = 0.8
WORSE = 0.12
"""A score so far below the running mean of the last frames' makes the tracker try from coarse to fine. The mean begins
with the first of these."""

DAMPING = 0.7
"""Share of the last motion that is expected to go on."""

OVAL_DEG, OVAL_SHARE = 78.0, 1.2
"""Half axes of the face's oval: angle, and share of the half height."""

SOFT_WEIGHT = 0.25
"""Weight of the mouth and the lids, which move by themselves."""

NEAR_ITERATIONS = (6, 0, 0)
FAR_ITERATIONS = (5, 4, 4)
"""Most iterations by level, finest first: from a prediction, and where that fails."""


@dataclass(frozen=True)
class Settings:
    """What the tracker does; everything but the defaults is there to be compared with.

    Attributes
    ----------
    update : str
        ``static``: the first frame is the only template. ``dynamic``: the template follows the last frame.
        ``references``: the same, and stored references undo its drift.
    surface : str
        ``cylinder``; ``face``: the smoothed depths of the mean face about it; ``learnt``: these, corrected by what the
        video shows (:mod:`evalkit.vision.relief`).
    normalised : bool
        Local contrast normalisation.
    robust : bool
        Weights by agreement and robust weights.
    recover : bool
        Look for a lost head.
    """

    update: Literal["static", "dynamic", "references"] = "references"
    surface: Literal["cylinder", "face", "learnt"] = "cylinder"
    normalised: bool = True
    robust: bool = True
    recover: bool = True


class CylinderTracker:
    """A head tracker (:class:`evalkit.vision.tracker.HeadTracker`) for one video.

    Parameters
    ----------
    settings : Settings, optional
    """

    def __init__(self, settings: Settings | None = None) -> None:
        self.settings = settings or Settings()

    def start(self, frame: Picture, camera: Camera, points_px: Array) -> HeadPose:
        """Begin with a frame and the 19 points in it; see :meth:`evalkit.vision.tracker.HeadTracker.start`."""
        start = start_from_points(points_px, camera)
        if self.settings.surface != "cylinder":
            start = replace(start, surface=mean_face_surface(start.stretch))
        return self.start_at(frame, camera, start)

    def start_at(self, frame: Picture, camera: Camera, start: Start) -> HeadPose:
        """Begin with a frame, a pose and a surface that are known."""
        self.camera, self.surface = camera, start.surface
        self._rigid = _rigid_weights(start.surface, start.points_mm)
        self._rotation, self._translation = self._sure = start.rotation, start.translation
        self._motion = np.zeros(3), np.zeros(3)
        self._lost_for = 0
        view = View(frame, camera)
        self._number = 0
        first = make_reference(0, view, self.surface, camera, start.rotation, start.translation)
        self.references: list[Reference] = [first]
        self._template = first.template
        usable = self._rigid[0] * first.template[0].weight
        self._relief = Relief(self.surface, camera, start.rotation, start.translation, usable)
        self._last: tuple[View, Fit] | None = None
        self._usual, self._before = USUAL_SCORE, USUAL_SCORE
        self._sharpness = sharpness(first.template[0].grey, usable)
        self._turn = 0
        self._weak_for = 0
        sharp = self._sharpness >= SHARP
        status = TrackStatus.TRACKED if sharp else TrackStatus.WEAK
        return HeadPose(start.rotation, start.translation, status, 1.0 if sharp else LOST_SCORE)

    def step(self, frame: Picture) -> HeadPose:
        """Pose of the next frame."""
        self._number += 1
        view = View(frame, self.camera)
        fit = self._looked_for(view) if self._lost_for else self._followed(view)
        self._weak_for = 0 if fit.score >= TRACKED_SCORE else self._weak_for + 1
        least = FOUND_SCORE if self._lost_for else LOST_SCORE
        if fit.score < least or self._weak_for > LONGEST_WEAK or not self._likely(fit):
            self._lost_for += 1
            self._before = 0.0
            self._motion = np.zeros(3), np.zeros(3)
            return LOST
        self._keep(view, fit)
        if fit.score < TRACKED_SCORE or not self._sharp(fit):
            return HeadPose(self._rotation, self._translation, TrackStatus.WEAK, min(LOST_SCORE, fit.score))
        return HeadPose(self._rotation, self._translation, TrackStatus.TRACKED, min(1.0, fit.score))

    def _likely(self, fit: Fit) -> bool:
        """Whether a pose is one that can be claimed: with the middle of the face in the picture, and known before.

        Where no reference has been, only the last frame speaks for a pose; if that was unsure itself, it may have been
        of a hand before the face.
        """
        x, y = self.camera.project(fit.rotation @ [0.0, 0.0, float(self.surface.radii_mm.mean())] + fit.translation)
        if not (0.0 <= x <= self.camera.width and 0.0 <= y <= self.camera.height):
            return False
        alone = self.settings.update == "references" and self._near(fit.rotation, fit.translation) is None
        doubted = alone and self.settings.recover and self._before < CLOSED_SCORE
        return fit.score >= ALONE_SCORE or not doubted

    def _sharp(self, fit: Fit) -> bool:
        """Whether a frame shows as much of the face as the first one, and that one enough."""
        if self._sharpness < SHARP:
            return False
        return sharpness(fit.seen, fit.visible * self._rigid[0]) >= SMEARED * self._sharpness

    def _followed(self, view: View) -> Fit:
        """From where the head was in the last frame."""
        turn, move = self._motion
        fit = self._follow(view, self._rotation @ rotation_from_vector(turn), self._translation + move)
        if fit.score < TRACKED_SCORE:
            # Motion that stopped, or that an occluder pretended.
            fit = max(fit, self._follow(view, self._rotation, self._translation), key=_score)
        if fit.score < CLOSED_SCORE and self.settings.update == "references":
            # An occluder may have taken the pose along.
            sure = [self._follow(view, *self._sure)] if self.settings.recover else []
            fit = max([fit, *sure, *self._close(view, fit)], key=_score)
        if fit.score < TRACKED_SCORE and self.settings.recover:
            fit = max(fit, self._search(view), key=_score)
        return fit

    def _looked_for(self, view: View) -> Fit:
        """A lost head: where it was last, and all over the frame, take turns, so that no frame takes long."""
        if self._lost_for % 2 or not self.settings.recover:
            return self._follow(view, self._rotation, self._translation)
        return self._search(view)

    def _near(self, rotation: Array, translation: Array) -> Reference | None:
        """The oldest reference near a pose: it carries the least error of others."""
        far = distances_deg(self.references, rotation, translation)
        return next((reference for reference, x in zip(self.references, far, strict=True) if x < NEAR_DEG), None)

    def _register(self, view: View, template: Template, rotation: Array, translation: Array) -> Fit:
        """From close by on the finest level alone, where the least is blurred; from coarse to fine if that fails."""
        fits: list[Fit] = []
        for iterations in (NEAR_ITERATIONS, FAR_ITERATIONS):
            fits.append(
                register(
                    view, self.surface, template, self._rigid, rotation, translation, iterations,
                    self.settings.normalised, self.settings.robust,
                )
            )  # fmt: skip
            if fits[-1].score > max(TRACKED_SCORE, self._usual - WORSE):
                break
        return max(fits, key=_score)

    def _follow(self, view: View, rotation: Array, translation: Array) -> Fit:
        """Registration against the reference that is near, or against the template of the last frame."""
        if self.settings.update != "references":
            return self._register(view, self._template, rotation, translation)
        reference = self._near(rotation, translation)
        if reference is not None:
            fit = self._register(view, reference.template, rotation, translation)
            if fit.score >= TRACKED_SCORE:
                return fit
        again = self._register(view, self._last_template(), rotation, translation)
        near = self._near(again.rotation, again.translation)
        if near is not None:
            # The last frame agrees with itself, whatever has come before the face: a reference decides.
            again = judge(
                view, self.surface, near.template, self._rigid, again.rotation, again.translation,
                self.settings.normalised,
            )  # fmt: skip
        return again if reference is None else max(fit, again, key=_score)

    def _turns(self) -> list[Reference]:
        """The references to try in this frame: the others take turns, the first one is in every turn."""
        self._turn += 1
        others = self.references[1:]
        return [self.references[0], *([others[self._turn % len(others)]] if others else [])]

    def _close(self, view: View, fit: Fit) -> list[Fit]:
        """Registrations against references that seemed far: a pose that drifted does not know which one is near."""
        arm = np.array([0.0, 0.0, float(self.surface.radii_mm.mean())])
        place = fit.rotation @ arm + fit.translation
        found = []
        for reference in self._turns():
            if self._near(fit.rotation, fit.translation) is reference:
                continue
            sight = towards(reference.rotation @ arm + reference.translation)
            rotation = towards(place) @ sight.T @ reference.rotation
            found.append(self._register(view, reference.template, rotation, place - rotation @ arm))
        return found

    def _last_template(self) -> Template:
        """The template with what the last frame showed, made when it is asked for."""
        if self._last is not None:
            view, fit = self._last
            shown = view.template(self.surface, fit.rotation, fit.translation)
            self._template = _updated(self._template, shown, fit.agreement, fit.score >= NEW_SCORE)
            self._last = None
        return self._template

    def _search(self, view: View) -> Fit:
        """The best pose at which the reference whose turn it is is found; the first one has every other turn."""
        self._turn += 1
        others = self.references[1:]
        reference = others[self._turn // 2 % len(others)] if others and self._turn % 2 else self.references[0]
        fits = [
            register(
                view, self.surface, reference.template, self._rigid, rotation, translation, FAR_ITERATIONS,
                self.settings.normalised, self.settings.robust,
            )
            for rotation, translation in search(view, self.surface, self.camera, reference)
        ]  # fmt: skip
        nothing = judge(view, self.surface, self._template, self._rigid, self._rotation, self._translation)
        return max([*fits, replace(nothing, score=-1.0)], key=_score)

    def _keep(self, view: View, fit: Fit) -> None:
        """Make a pose the one to go on from."""
        rotation = nearest_rotation(fit.rotation)
        if self._lost_for:
            self._motion = np.zeros(3), np.zeros(3)
        else:
            self._motion = (
                DAMPING * rotation_vector((self._rotation.T @ rotation)[None])[0],
                DAMPING * (fit.translation - self._translation),
            )
        self._lost_for = 0
        self._rotation, self._translation = rotation, fit.translation
        self._usual += 0.1 * (fit.score - self._usual)
        self._before = fit.score
        if fit.score >= CLOSED_SCORE:
            self._sure = rotation, fit.translation
        if self.settings.update == "static" or fit.score < TRACKED_SCORE:
            # What is not known to be the face must not become the template of it.
            return
        self._last = view, fit
        if self.settings.update == "dynamic":
            self._last_template()
        elif (
            fit.score >= NEW_SCORE
            and len(self.references) < MOST_REFERENCES
            and min(distances_deg(self.references, rotation, fit.translation)) > NEW_DEG
        ):
            own = (fit.agreement > 0.5).astype(np.float32) if self.settings.robust else None
            reference = make_reference(self._number, view, self.surface, self.camera, rotation, fit.translation, own)
            self.references.append(reference)
        if self.settings.surface == "learnt" and fit.score >= NEW_SCORE:
            self._learn(view)

    def _learn(self, view: View) -> None:
        """Make a frame a key frame of the relief if it differs from the others, and go on with what it taught."""
        relief, first = self._relief, self.references[0]
        known = np.stack([first.rotation, *(key.rotation for key in relief.keys)])
        apart = np.degrees(rotation_angle(known.transpose(0, 2, 1) @ self._rotation))
        if len(relief.keys) >= MOST_KEYS or apart.min() < KEY_DEG or apart[0] > WIDEST_DEG:
            return
        key = relief.add(self._number, view, self.surface, first.template, self._rotation, self._translation)
        relief.adjust()
        self.surface = relief.surface()
        self._rotation, self._translation = key.rotation, key.translation
        adjusted = {key.number: key for key in relief.keys}
        remade = []
        for old in self.references:
            pose = adjusted.get(old.number, old)
            remade.append(old.moved(self.surface, pose.rotation, pose.translation))
        self.references = remade
        self._template, self._last = view.template(self.surface, key.rotation, key.translation), None


def _score(fit: Fit) -> float:
    return fit.score


def _updated(old: Template, shown: Template, agreement: Map, growing: bool) -> Template:
    """The template with what a frame shows, where the two agree or, if it may grow, the template knew nothing."""
    found = []
    for before, now in zip(old, shown, strict=True):
        agreeing = cv2.resize(agreement, before.grey.shape[::-1], interpolation=cv2.INTER_AREA)
        taken = ((agreeing > 0.5) & (before.weight >= 0.1) | growing & (before.weight < 0.1)) & (now.weight > 0)
        found.append(
            Texture(
                np.where(taken, now.grey, before.grey), np.where(taken, now.weight, before.weight).astype(np.float32)
            )
        )
    return found


def _rigid_weights(surface: Surface, points_mm: Array) -> tuple[Map, ...]:
    """Weight of each place by level: less about the mouth and the jaw, and about the lids."""
    at = dict(zip(FACE_POINTS, points_mm, strict=True))
    mouth = 0.5 * (at["mouth corner left"] + at["mouth corner right"])
    width = float(np.linalg.norm(at["mouth corner left"] - at["mouth corner right"]))
    weights = []
    for grid in surface.grids:
        x, y = grid.points[:, 0], grid.points[:, 1]
        front = grid.points[:, 2] > 0
        jaw = (np.abs(x - mouth[0]) < 0.75 * width) & (y < mouth[1] + 0.25 * width) & front
        soft = jaw
        for side in ("left", "right"):
            inner, outer = at[f"eye inner {side}"], at[f"eye outer {side}"]
            middle, half = 0.5 * (inner + outer), 0.5 * float(np.linalg.norm(outer - inner))
            soft |= (np.hypot(x - middle[0], 1.6 * (y - middle[1])) < 1.2 * half) & front
        # Outside of an oval there are hair, ears, neck, and in the corners what stands behind the head.
        angle = np.degrees(np.arctan2(x, grid.points[:, 2]))
        middle = 0.5 * (surface.top_mm + surface.bottom_mm)
        away = np.hypot(angle / OVAL_DEG, (y - middle) / (OVAL_SHARE * (surface.top_mm - middle)))
        oval = np.clip((1.15 - away) / 0.3, 0.0, 1.0)
        weight = (np.where(soft, SOFT_WEIGHT, 1.0) * oval).reshape(grid.shape).astype(np.float32)
        weights.append(cv2.GaussianBlur(weight, (0, 0), 0.02 * len(weight)))
    return tuple(weights)
