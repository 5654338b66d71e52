"""Head pose from markers on moving skin: each marker with its own covariance, estimated from the take itself.

No marker of a face is rigid. Skin over the forehead slides along the bone by millimetres and hardly moves off it;
a cheek moves in every direction, but not in every frame. In the head frame a marker m of frame i therefore stands
at ``P[m] + E[i, m]`` where E has a Student t distribution with a scatter matrix Σ[m] of its own,

    x[i, m] = R[i] (P[m] + E[i, m]) + T[i],     E[i, m] ~ t(0, Σ[m], ν),

and shape P, scatters Σ and all poses are estimated together; ν = 4. The poses have six unknowns a frame, however
long the take, so that plain residual variances are too small, the more so the more a marker counts: re-weighting by
them collapses onto a few markers. The expectation step here adds what the pose takes away, which makes the variances
those of restricted maximum likelihood (the poses integrated out).

What no model of this kind can see is skin that moves as one piece: the part of it that equals a head motion is one.
Correlation between neighbours is therefore left out on purpose. Estimated freely, together with the poses, its range
grows over the whole face and the estimate gets worse than with plain least squares.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from evalkit.capture.model import Capture
from evalkit.capture.rigid import MIN_SEEN, RigidMarkers, choose_rigid, distance_variation
from evalkit.errors import EvalkitError
from evalkit.geometry import (
    Array,
    blocks,
    cross_matrix,
    mean_rotation,
    nearest_rotation,
    rotation_angle,
    rotation_from_vector,
    undo_motion,
)
from evalkit.pose.model import Pose, PoseEstimator, check, moments, whole_markers
from evalkit.pose.qcp import qcp
from evalkit.pose.reference import reference_shape

SUBSET = 1000
"""Frames that the covariances are estimated from, spread evenly over the take."""

MIN_MARKERS = 5
"""Fewest markers that can tell skin from bone: n markers show (3n-6)(3n-5)/2 second moments of what no pose
explains and have 6n variances and covariances; from five on the former are more."""

MIN_FRAMES = 10

MAX_ROUNDS = 300
TOLERANCE = 1e-3
"""Largest relative change of a variance in the last round."""

FLOOR = 1e-5
"""Smallest standard deviation relative to the size of the shape: 0.6 µm on a face, below the rounding of single
precision two metres from the origin."""

NU = 4.0
"""Degrees of freedom of the t distribution, the usual choice where they are not estimated (Lange et al. 1989):
skin rests most of the time and then moves far."""

AGAIN = 10
"""Rounds after which the correlation of the residuals in time is looked at again."""

SPARE = 0.01
"""Part of the information about rotation that the markers left out of an automatic choice may have together."""

LOOSE = 0.05
"""Skin motion (standard deviation per axis) of the best marker, relative to the size of the shape, from which on
nothing can be said to move as one rigid body: three degrees, seen from the centroid."""

BODY_MM = 500.0
"""A take that spreads further than this shows more than a head."""

MAX_STEPS = 100
STEP = 1e-10
"""Last step of a frame's pose, rad and parts of the size of the shape."""

BLOCK = 4096
"""Frames solved at once, so that working memory stays small in long takes."""


@dataclass(frozen=True, eq=False)
class SkinModel:
    """How each marker moves against the skull.

    Attributes
    ----------
    template : ndarray, shape (M, 3), mm
        Mean place of every marker in the head frame; the head frame is the pose of one frame.
    scatter : ndarray, shape (M, 3, 3), mm²
        Σ, in the axes of the template.
    variance : ndarray, shape (M,), mm²
        Mean square of the skin motion per axis over the frames, pose uncertainty included.
    share : ndarray, shape (M,)
        Part of the information about rotation that each marker has; sums to one.
    pose_std_deg, pose_std_mm : float
        Standard deviation that the model promises for the rotation (all three axes together) and for the
        position of the centroid in the median frame, were the markers' motions independent. They are not, so
        this is a lower limit.
    effective_frames : float
        Number of independent observations that the frames are worth for a variance, from the correlation of the
        residuals in time.
    rounds : int
    converged : bool
    warnings : list of str
    """

    template: Array
    scatter: Array
    variance: Array
    share: Array
    pose_std_deg: float
    pose_std_mm: float
    effective_frames: float
    rounds: int
    converged: bool
    warnings: list[str] = field(default_factory=list)

    @property
    def weights(self) -> Array:
        """Relative inverse variances, shape (M,), the largest 1: for estimators with one weight a marker."""
        inverse = 3.0 / np.trace(self.scatter, axis1=1, axis2=2)
        return np.asarray(inverse / inverse.max())

    def part(self, columns: Sequence[int] | NDArray[np.intp]) -> SkinModel:
        """The model of some of the markers."""
        k = np.asarray(columns, dtype=int)
        share = self.share[k] / self.share[k].sum()
        return SkinModel(
            self.template[k], self.scatter[k], self.variance[k], share, self.pose_std_deg,
            self.pose_std_mm, self.effective_frames, self.rounds, self.converged, list(self.warnings),
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class SkinMarkers(RigidMarkers):
    """Markers chosen and weighted by how their skin moves.

    Attributes
    ----------
    model : SkinModel or None
        Of the chosen markers; None where the take could not tell (`warnings` say why).
    """

    model: SkinModel | None = None


def skin_model(points: ArrayLike, labels: Sequence[str] | None = None) -> SkinModel:
    """Shape and scatter matrices of markers on moving skin, without being told which is rigid.

    With the pose's six unknowns u (small rotation about the centroid and translation, in the head frame),
    ``J[m] = [-[P[m] - Pbar]x, I]`` and t weights τ, one round of the EM algorithm is

        A[i] = sum_m τ[i, m] J[m]' Σ[m]^-1 J[m],    u[i] = A[i]^-1 sum_m τ[i, m] J[m]' Σ[m]^-1 e[i, m]
        τ[i, m] = (ν + 3) / (ν + r' Σ[m]^-1 r + trace(Σ[m]^-1 J[m] A[i]^-1 J[m]'))
        Σ[m] = sum_i τ[i, m] (r r' + J[m] A[i]^-1 J[m]') / sum_i τ[i, m]

    with e the residual before and r that after the update of the pose. The second term of Σ is what the pose took
    from the residual. Σ is then shrunk towards ``trace(Σ)/3 I`` by ``1 / (n + 1)``: the prior is worth one
    independent observation (unit information), and for a variance the frames are worth
    ``n = F / (1 + 2 sum_k ρ_k²)``, where ρ is the mean autocorrelation of the residuals up to its first zero.
    Without it the likelihood does not punish six directions on six markers for having no variance at all, since
    six unknowns can always explain them.

    Parameters
    ----------
    points : array_like, shape (F, M, 3), mm, NaN where missing
        At least five markers. At most :data:`SUBSET` frames are used.
    labels : sequence of str, optional
        Names used in messages.

    Raises
    ------
    EvalkitError
        If there are fewer than five markers, fewer than ten frames with a pose, or no shape can be found.

    References
    ----------
    Dempster, Laird & Rubin, J. R. Stat. Soc. B 39 (1977), doi:10.1111/j.2517-6161.1977.tb01600.x;
    Patterson & Thompson, Biometrika 58 (1971), doi:10.1093/biomet/58.3.545 (restricted likelihood);
    Lange, Little & Taylor, J. Am. Stat. Assoc. 84 (1989), doi:10.1080/01621459.1989.10478852 (t errors);
    Bayley & Hammersley, Suppl. J. R. Stat. Soc. 8 (1946), doi:10.2307/2983560 (independent observations);
    Kass & Wasserman, J. Am. Stat. Assoc. 90 (1995), doi:10.1080/01621459.1995.10476592 (unit information).
    """
    x = whole_markers(points)
    if x.shape[1] < MIN_MARKERS:
        raise EvalkitError(f"{x.shape[1]} markers cannot tell skin from bone; at least {MIN_MARKERS} are needed")
    x = x[np.unique(np.linspace(0, len(x) - 1, min(len(x), SUBSET)).astype(int))] if len(x) else x
    template = reference_shape(x, "mean", labels=labels)
    first = qcp(template, x)
    if first.ok.sum() < MIN_FRAMES:
        raise EvalkitError(f"{first.ok.sum()} frames give a head pose; skin motion needs at least {MIN_FRAMES}")
    em = _Rounds(template, x[first.ok], first.rotations[first.ok], first.translations[first.ok])
    em.run(isotropic=True)
    em.run(isotropic=False)
    return em.model()


class _Rounds:
    """State of the EM algorithm: shape, poses, scatters, t weights."""

    def __init__(self, template: Array, points: Array, rotations: Array, translations: Array) -> None:
        self.x, self.template, self.rotations, self.translations = points, template, rotations, translations
        self.seen = np.isfinite(points[:, :, 0])
        self.size = float(np.sqrt(((template - template.mean(axis=0)) ** 2).sum(axis=1).mean()))
        self.floor = (FLOOR * self.size) ** 2
        count = np.maximum(self.seen.sum(axis=0), 1)
        square = (self._residuals() ** 2).sum(axis=(0, 2)) / (3 * count)
        self.scatter = max(float(square.mean()), self.floor) * np.tile(np.eye(3), (len(template), 1, 1))
        self.tau = self.seen.astype(np.float64)
        self.effective = float(len(points))
        self.rounds, self.converged = 0, False

    def _residuals(self) -> Array:
        e = undo_motion(self.rotations, self.translations, self.x) - self.template
        return e if self.seen.all() else np.where(self.seen[:, :, None], e, 0.0)

    def run(self, isotropic: bool) -> None:
        self.converged = False
        for k in range(MAX_ROUNDS):
            self.rounds += 1
            if not isotropic and k % AGAIN == 0:
                self.effective = _effective_frames(self.whitened())
            jacobian, inverse = jacobians(self.template), _inverse(self.scatter)
            covariance = self._pose_step(jacobian, inverse)
            r = self._residuals()
            if not isotropic:
                self._t_step(r, jacobian, inverse, covariance)
            total = self.tau.sum(axis=0)
            offset = (self.tau[:, :, None] * r).sum(axis=0) / total[:, None]
            self.template = self.template + offset
            r = r - np.where(self.seen[:, :, None], offset, 0.0)
            scatter = self._second_moment(r, self.tau, jacobian, covariance) / total[:, None, None]
            round_part = np.trace(scatter, axis1=1, axis2=2)[:, None, None] / 3.0 * np.eye(3)
            shrink = 1.0 if isotropic else 1.0 / (self.effective + 1.0)
            scatter = (1.0 - shrink) * scatter + shrink * round_part
            scatter += self.floor * np.eye(3)
            change = np.linalg.norm(scatter - self.scatter, axis=(1, 2)) / np.linalg.norm(self.scatter, axis=(1, 2))
            self.scatter = scatter
            if change.max() < TOLERANCE:
                self.converged = True
                break

    def _pose_step(self, jacobian: Array, inverse: Array) -> Array:
        """Update every pose; return the covariances (F, 6, 6) of its six unknowns."""
        weighted = inverse @ jacobian
        information = (self.tau @ (jacobian.transpose(0, 2, 1) @ weighted).reshape(-1, 36)).reshape(-1, 6, 6)
        e = self._residuals() * self.tau[:, :, None]
        covariance = _inverse(information)
        step = np.einsum("fij,fj->fi", covariance, e.reshape(len(e), -1) @ weighted.reshape(-1, 6))
        self.rotations, self.translations = moved(self.rotations, self.translations, step, self.template)
        return covariance

    def _t_step(self, r: Array, jacobian: Array, inverse: Array, covariance: Array) -> None:
        distance = np.einsum("fmi,mij,fmj->fm", r, inverse, r, optimize=True)
        spread = (jacobian.transpose(0, 2, 1) @ inverse @ jacobian).reshape(-1, 36)
        distance += covariance.reshape(-1, 36) @ spread.T
        tau = (NU + 3.0) / (NU + distance)
        self.tau = np.where(self.seen, tau, 0.0)

    def _second_moment(self, r: Array, tau: Array, jacobian: Array, covariance: Array) -> Array:
        """``sum_i τ (r r' + J A^-1 J')`` of every marker, shape (M, 3, 3)."""
        seen = np.einsum("fmi,fmj->mij", tau[:, :, None] * r, r, optimize=True)
        taken = jacobian @ (tau.T @ covariance.reshape(-1, 36)).reshape(-1, 6, 6) @ jacobian.transpose(0, 2, 1)
        return np.asarray(seen + taken)

    def whitened(self) -> Array:
        """Residuals in units of their standard deviation, shape (F, 3M), 0 where missing."""
        lower = np.linalg.cholesky(np.linalg.inv(self.scatter))
        return np.asarray(np.einsum("mji,fmj->fmi", lower, self._residuals()).reshape(len(self.x), -1))

    def model(self) -> SkinModel:
        jacobian, inverse = jacobians(self.template), _inverse(self.scatter)
        weighted = jacobian.transpose(0, 2, 1) @ inverse @ jacobian
        tau = np.where(self.seen, self.tau, 0.0)
        information = (tau @ weighted.reshape(-1, 36)).reshape(-1, 6, 6)
        covariance = _inverse(information)
        count = self.seen.sum(axis=0)
        moment = self._second_moment(self._residuals(), self.seen.astype(float), jacobian, covariance)
        variance = np.trace(moment, axis1=1, axis2=2) / (3 * count)
        share = rotation_share(tau.mean(axis=0)[:, None, None] * weighted)
        spread = np.einsum("fii->fi", covariance)
        turn = float(np.degrees(np.sqrt(np.median(spread[:, :3].sum(axis=1)))))
        shift = float(np.sqrt(np.median(spread[:, 3:].sum(axis=1))))
        warnings = []
        if np.sqrt(variance.min()) > LOOSE * self.size:
            warnings.append(
                f"no marker stays with the others: the steadiest moves by {np.sqrt(variance.min()):.1f} mm per axis "
                f"(standard deviation) on a shape of {self.size:.0f} mm; the head pose means little"
            )
        angle = rotation_angle(self.rotations @ mean_rotation(self.rotations).T)
        turned = float(np.degrees(np.sqrt((angle**2).mean())))
        # What is seen to turn is the head and the error together.
        if turn**2 > 0.5 * turned**2 and np.sqrt(variance.max()) > 10 * FLOOR * self.size:
            warnings.append(
                f"the rotation is uncertain by {turn:.2f} deg and turns by {turned:.2f} deg (rms): "
                "the head's rotation cannot be told from skin motion"
            )
        if not self.converged:
            warnings.append(f"the markers' variances did not settle in {self.rounds} rounds")
        return SkinModel(
            self.template, self.scatter, variance, share, turn, shift, self.effective,
            self.rounds, self.converged, warnings,
        )  # fmt: skip


def _inverse(matrices: Array) -> Array:
    return np.asarray(np.linalg.inv(matrices), dtype=np.float64)


def jacobians(template: Array) -> Array:
    """``[-[P - Pbar]x, I]`` of every marker, shape (M, 3, 6)."""
    arm = template - template.mean(axis=0)
    return np.concatenate([-cross_matrix(arm), np.broadcast_to(np.eye(3), (len(arm), 3, 3))], axis=2)


def moved(rotations: Array, translations: Array, step: Array, template: Array) -> tuple[Array, Array]:
    """Poses after small motions (F, 6) in the head frame: a rotation vector about the centroid and a translation."""
    centre = template.mean(axis=0)
    turned = rotations @ rotation_from_vector(step[:, :3])
    at = translations + np.einsum("fij,fj->fi", rotations, step[:, 3:] + centre)
    return turned, at - turned @ centre


def rotation_share(information: Array) -> Array:
    """Part of each marker in the information about rotation, the translation eliminated.

    Parameters
    ----------
    information : ndarray, shape (M, 6, 6)
        ``J' Σ^-1 J`` of each marker.

    Returns
    -------
    ndarray, shape (M,), sum 1
    """
    covariance = np.linalg.inv(information.sum(axis=0))
    # Columns that turn about the point where rotation and translation decouple.
    decoupled = covariance[:, :3] @ np.linalg.inv(covariance[:3, :3])
    own = decoupled.T @ information @ decoupled
    return np.asarray(np.einsum("ij,mji->m", covariance[:3, :3], own) / 3.0)


def _effective_frames(signals: Array) -> float:
    """Independent observations of a variance in signals (F, N): ``F / (1 + 2 sum ρ²)`` to the first zero of mean ρ."""
    frames = len(signals)
    power = np.zeros(frames + 1)
    for signal in (signals - signals.mean(axis=0)).T:
        power += np.abs(np.fft.rfft(signal, 2 * frames)) ** 2
    correlation = np.fft.irfft(power)[:frames]
    if correlation[0] <= 0.0:
        return float(frames)
    correlation /= correlation[0]
    negative = np.flatnonzero(correlation <= 0.0)
    end = negative[0] if len(negative) else frames
    return float(frames / (1.0 + 2.0 * (correlation[1:end] ** 2).sum()))


def skin_estimator(model: SkinModel) -> PoseEstimator:
    """Pose estimator for the markers of a model; unlike those in the table it is made for one take.

    It minimises ``sum_m w (ν + 3) log(1 + r' Σ[m]^-1 r / ν)`` frame by frame: the most probable pose if the markers
    move as the model says. The scatters are turned with the template that it is called with. Weights given to it
    multiply the inverse scatters, so do not pass ``model.weights`` again.
    """

    def function(template: ArrayLike, points: ArrayLike, weights: ArrayLike | None = None) -> Pose:
        return _skin_pose(model, template, points, weights)

    return PoseEstimator(function, "generalised least squares with the skin's own covariances", "Lange et al. 1989")


def _skin_pose(model: SkinModel, template: ArrayLike, points: ArrayLike, weights: ArrayLike | None) -> Pose:
    shape, observed = check(template, points)
    if len(shape) != len(model.template):
        raise EvalkitError(f"the skin model has {len(model.template)} markers, the template {len(shape)}")
    turn = _turn_between(model, shape)
    inverse = _inverse(turn @ model.scatter @ turn.T)
    given: Array = np.ones(len(shape)) if weights is None else np.asarray(weights, dtype=np.float64)
    rotations, translations = np.empty((len(observed), 3, 3)), np.empty((len(observed), 3))
    status, final = np.empty(len(observed), dtype=np.int8), np.zeros(observed.shape[:2])
    for part in blocks(len(observed), BLOCK):
        own = given[part] if given.ndim == 2 else given
        start = qcp(shape, observed[part], own * model.weights)
        rotations[part], translations[part], status[part] = start.rotations, start.translations, start.status
        used = (start.weights > 0) & np.isfinite(observed[part]).all(axis=2) & np.isfinite(shape).all(axis=1)
        k = np.flatnonzero(start.ok)
        if not len(k):
            continue
        w = np.where(used, own, 0.0)[k]
        w = w / w.max(axis=1, keepdims=True)
        x = np.where(used[:, :, None], observed[part], 0.0)[k]
        k += part.start
        rotations[k], translations[k], tau = _solve(np.nan_to_num(shape), inverse, x, w, rotations[k], translations[k])
        final[k] = tau * model.weights
    return Pose(rotations, translations, status, shape, final)


def _turn_between(model: SkinModel, shape: Array) -> Array:
    """Rotation (3, 3) from the axes of the model's template to those of another one."""
    sums = moments(model.template, shape[None], model.weights)
    return np.asarray(nearest_rotation(sums.cross)[0])


def _solve(
    shape: Array, inverse: Array, points: Array, weights: Array, rotations: Array, translations: Array
) -> tuple[Array, Array, Array]:
    """Re-weighted Gauss-Newton steps; every frame stops by itself, so that no frame depends on its company."""
    jacobian = jacobians(shape)
    weighted = inverse @ jacobian
    information = (jacobian.transpose(0, 2, 1) @ weighted).reshape(-1, 36)
    lower = np.linalg.cholesky(inverse)
    arm = float(np.sqrt(((shape - shape.mean(axis=0)) ** 2).sum(axis=1).mean()))
    unit = np.array([1.0, 1.0, 1.0, arm, arm, arm])
    rotations, translations, tau = rotations.copy(), translations.copy(), weights.copy()
    active = np.arange(len(points))
    for _ in range(MAX_STEPS):
        e = undo_motion(rotations[active], translations[active], points[active]) - shape
        white = np.matmul(e.transpose(1, 0, 2), lower)
        distance = np.einsum("mfi,mfi->fm", white, white)
        part = weights[active] * ((NU + 3.0) / (NU + distance))
        tau[active] = part
        normal = (part @ information).reshape(-1, 6, 6)
        right = (e * part[:, :, None]).reshape(len(active), -1) @ weighted.reshape(-1, 6)
        step = np.linalg.solve(normal, right[:, :, None])[:, :, 0]
        rotations[active], translations[active] = moved(rotations[active], translations[active], step, shape)
        active = active[np.abs(step / unit).max(axis=1) > STEP]
        if not len(active):
            break
    return rotations, translations, tau


def automatic_rigid(take: Capture) -> SkinMarkers:
    """Choose and weight the markers that tell the head's motion, from all of a face take and without being told any.

    Every position that is seen in half of the frames or more enters :func:`skin_model`. Left out of the result are
    the markers that tell least about rotation, as long as they have one per cent of the information together.
    Where the model cannot be had (fewer than five markers, too few frames, a take of more than a head), the choice
    by constant distances of :func:`evalkit.capture.rigid.choose_rigid` serves instead, all weights equal.

    Parameters
    ----------
    take : Capture

    Raises
    ------
    EvalkitError
        If no three markers can serve.
    """
    positions = np.array([kind == "position" for kind in take.quantities], dtype=bool)
    seen = take.visible.mean(axis=0) if take.frames else np.zeros(len(take.labels))
    columns = np.flatnonzero(positions & (seen >= MIN_SEEN))
    extent = _extent(take.points[:, columns])
    if extent > BODY_MM:
        return _by_distances(
            take,
            f"the markers spread over {extent / 1000:.1f} m, more than a head: the most rigid set need not be on it; "
            "name the head's markers with rigid",
        )
    columns, warnings = _without_copies(take, columns)
    labels = [take.labels[c] for c in columns]
    try:
        model = skin_model(take.points[:, columns], labels)
    except EvalkitError as error:
        return _by_distances(take, f"skin motion not modelled ({error}): rigid markers chosen by constant distances")
    order = np.argsort(model.share, kind="stable")
    dropped = order[np.cumsum(model.share[order]) <= SPARE][: max(len(order) - MIN_MARKERS + 1, 0)]
    kept = np.setdiff1d(np.arange(len(columns)), dropped)
    std = np.sqrt(model.variance)
    best = kept[np.argsort(-model.share[kept], kind="stable")]
    told = ", ".join(f"{labels[k]} {model.share[k]:.0%} ({std[k]:.2f} mm)" for k in best[:4])
    reason = (
        f"weighted automatically: {len(kept)} of {len(columns)} markers have {1 - model.share[dropped].sum():.1%} of "
        f"the information about rotation, most {told}; in brackets the skin motion per axis (standard deviation), "
        f"from {std.min():.2f} to {std.max():.2f} mm over all"
    )
    chosen = [int(c) for c in columns[kept]]
    mean, pair_std = distance_variation(take.points[:, chosen])
    part = model.part(kept)
    return SkinMarkers(
        [take.labels[c] for c in chosen], chosen, True, reason, mean, pair_std, part.weights, std[kept],
        model.share[kept], warnings + model.warnings, part,
    )  # fmt: skip


def _by_distances(take: Capture, warning: str) -> SkinMarkers:
    found = choose_rigid(take, "auto")
    return SkinMarkers(
        found.labels, found.columns, True, found.reason, found.pair_mean, found.pair_std, warnings=[warning]
    )


def _extent(points: Array) -> float:
    """Longest side of the box around the markers, mm, median over up to a thousand frames."""
    some = points[:: max(len(points) // 1000, 1)]
    some = some[np.isfinite(some[:, :, 0]).any(axis=1)]
    return float(np.median(np.nanmax(some, axis=1) - np.nanmin(some, axis=1), axis=0).max()) if len(some) else 0.0


def _without_copies(take: Capture, columns: NDArray[np.intp]) -> tuple[NDArray[np.intp], list[str]]:
    """Columns less those of markers that stand where an earlier one stands: two that agree prove nothing."""
    mean, _ = distance_variation(take.points[:, columns])
    same = mean <= FLOOR * np.nanmax(mean, initial=0.0)
    copies = np.flatnonzero(np.triu(same, 1).any(axis=0))
    if not len(copies):
        return columns, []
    names = ", ".join(take.labels[columns[k]] for k in copies)
    return np.delete(columns, copies), [f"{names}: copies of other markers, left out of the estimate"]
