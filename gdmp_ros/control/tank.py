"""
Passivity under varying stiffness: an energy tank in front of the impedance law.

What the controller stores is ``V = ½ eᵀ K e`` of the clipped error. Whatever else changes the
energy of robot and spring (a stiffness that grows, a reference that moves, the clip, Coriolis
compensation, the null space, the limits) is metered at the motors as ``τ·Δq - ΔU + ΔV`` and drawn
from a tank of bounded content. Robot, spring and tank together then never give more than they
were given. What the law dissipates, and the friction of the joints, fills the tank again.

Sources: Ferraguti, Secchi, Fantuzzi, ICRA 2013; Ferraguti, Preda, Manurung, Bonfè, Lambercy,
Gassert, Muradore, Fiorini, Secchi, IEEE T-RO 2015 (tanks); Kronander, Billard, IEEE T-RO 2016
(`growth_margin`).
"""
from __future__ import annotations

from dataclasses import dataclass
import math

import numpy as np

from gdmp_ros.compilation import compiled
from gdmp_ros.control.governor import follow, moved
from gdmp_ros.control.impedance import (
    ACCELERATION,
    clip_norm,
    POSE,
    rotation_error,
    STIFFNESS,
    TWIST,
)
from gdmp_ros.control.limits import (
    ENERGY,
    LimitSettings,
    POSITION_ERROR,
    ROTATION_ERROR,
    STIFFNESS_BOUNDS,
    STIFFNESS_RATE,
)
from gdmp_ros.control.measurement import Measurement
from gdmp_ros.manifolds.linalg import cholesky, congruence, invert_lower, multiply_transposed
from gdmp_ros.manifolds.spectral import symmetric_eigen

#: At most dt over this share of the content is spent in a tick: the tank empties smoothly [s].
SPENDING_S = 0.01
#: Feed-forward fades out below this share of the energy at the start.
LEAST_SHARE = 0.1
#: Largest damping with which an empty tank holds back what still draws from it [Nm s/rad].
MOST_DAMPING = 20.0
_HALVINGS = 20


@dataclass(frozen=True)
class TankSettings:
    """
    The energy tank.

    :ivar energy: at the start [J]
    :ivar capacity: most that it holds; what flows in beyond that is lost [J]
    :ivar refill: power that flows in from nowhere, for tasks that do work for ever; with 0 the
        controller is passive [W]
    :ivar passive: False meters only, and holds nothing back
    """

    energy: float = 5.0
    capacity: float = 10.0
    refill: float = 0.0
    passive: bool = True


@compiled
def potential(pose, target, stiffness, position_clip, rotation_clip, error):
    """``½ eᵀ K e`` of the clipped error, which is written to ``error`` [J]."""
    for i in range(3):
        error[i] = target[POSE + i] - pose[i]
    rotation_error(pose[3:7], target[POSE + 3:POSE + 7], error[3:])
    clip_norm(error[:3], position_clip)
    clip_norm(error[3:], rotation_clip)
    total = 0.0
    for i in range(6):
        for j in range(6):
            total += error[i] * stiffness[6 * i + j] * error[j]
    return 0.5 * total


@compiled
def relative_modes(old, new, values, modes):
    """
    Modes of ``new`` relative to ``old``: ``old = Σ wₖ wₖᵀ``, ``new = Σ βₖ wₖ wₖᵀ``.

    :param old: 36 numbers, positive definite
    :param new: 36 numbers
    :param values: result, the βₖ
    :param modes: result, the wₖ as rows, 36 numbers
    """
    lower, inverse, half, turned, work = (np.empty(36), np.empty(36), np.empty(36), np.empty(36),
                                          np.empty(36))
    cholesky(6, old, lower)
    invert_lower(6, lower, inverse)
    congruence(6, inverse, new, turned, half)
    symmetric_eigen(6, turned, values, half, work)
    multiply_transposed(6, half, lower, modes)


@compiled
def compose_modes(values, modes, out):
    """``Σ βₖ wₖ wₖᵀ``."""
    for i in range(6):
        for j in range(i + 1):
            total = 0.0
            for k in range(6):
                total += values[k] * modes[6 * k + i] * modes[6 * k + j]
            out[6 * i + j], out[6 * j + i] = total, total


@compiled
def bound_stiffness(stiffness, low, high, excess):
    """
    Bring the eigenvalues into their bounds; the upper bound wins.

    Relative to ``diag(t, t, t, r, r, r)``: without coupling these are the eigenvalues of the
    translational and of the rotational block, each over its bound.

    :param stiffness: 36 numbers, changed
    :param low: lower bound, 36 numbers
    :param high: upper bound
    """
    values, modes = np.empty(6), np.empty(36)
    for bound, side in ((low, 1.0), (high, -1.0)):
        relative_modes(bound, stiffness, values, modes)
        bitten = False
        for k in range(6):
            beyond = -side * math.log(max(values[k], 1e-12))
            if beyond > 1e-9:
                excess[STIFFNESS_BOUNDS] = max(excess[STIFFNESS_BOUNDS], beyond)
                values[k] = 1.0
                bitten = True
        if bitten:
            compose_modes(values, modes, stiffness)


@compiled
def _admit_stiffness(old, wanted, error, change, spendable, excess):
    """
    Go from ``old`` towards ``wanted``: falling modes always, growing ones as there is energy.

    :param change: largest log of a mode's ratio in this tick
    :param spendable: for growth, beyond what falling modes give [J]
    :returns: energy needed (negative: given back), and energy that growth was short of [J]
    """
    values, modes, cost = np.empty(6), np.empty(36), np.zeros(6)
    relative_modes(old, wanted, values, modes)
    given, needed, short = 0.0, 0.0, 0.0
    for k in range(6):
        size = abs(math.log(max(values[k], 1e-12)))
        if size > change:
            excess[STIFFNESS_RATE] = max(excess[STIFFNESS_RATE], size - change)
            values[k] = math.exp(math.copysign(change, values[k] - 1.0))
        along = 0.0
        for i in range(6):
            along += modes[6 * k + i] * error[i]
        cost[k] = 0.5 * (values[k] - 1.0) * along * along
        given -= min(cost[k], 0.0)
    # Each its part: modes that store nothing need not wait for those that do.
    part = max(spendable + given, 0.0) / 6.0
    for k in range(6):
        if cost[k] > part:
            values[k] = 1.0 + (values[k] - 1.0) * part / cost[k]
            short += cost[k] - part
            cost[k] = part
        needed += max(cost[k], 0.0)
    compose_modes(values, modes, wanted)
    return needed - given, short


@compiled
def _admit_reference(followed, pose, stiffness, clips, spendable, dt, error):
    """
    Move the follower's reference as far as there is energy.

    :returns: energy needed, and energy it was short of [J]
    """
    place = np.empty(TWIST + 6)
    place[:7] = followed[:7]
    before = potential(pose, place, stiffness, clips[0], clips[1], error)
    moved(followed, dt, place)
    needed = potential(pose, place, stiffness, clips[0], clips[1], error) - before
    short = max(needed - spendable, 0.0)
    if short > 0.0:
        # The energy is convex along the step and affordable at its beginning.
        low, high = 0.0, 1.0
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            moved(followed, middle * dt, place)
            needed = potential(pose, place, stiffness, clips[0], clips[1], error) - before
            if needed <= spendable:
                low = middle
            else:
                high = middle
        moved(followed, low * dt, place)
        needed = potential(pose, place, stiffness, clips[0], clips[1], error) - before
        for i in range(TWIST, ACCELERATION + 6):
            followed[i] *= low
    followed[:7] = place[:7]
    return needed, short


@compiled
def admit(followed, stiffness, wanted, pose, jacobian, inertia, limits, bounds, clips, change,
          spendable, dt, error, excess):
    """
    Let a tick pass for the reference and the stiffness, inside limits and energy.

    :param followed: the follower's reference: pose 7, twist 6, acceleration 6; changed
    :param stiffness: applied so far, 36 numbers; changed
    :param wanted: the given target, `TARGET_SIZE` numbers; changed
    :param pose: measured
    :param limits: `gdmp_ros.control.governor.limit_numbers`
    :param bounds: of the stiffness, lower and upper, shape (2, 36)
    :param clips: largest position and rotation error acted upon [m, rad]
    :param change: largest log of a stiffness mode's ratio in a tick
    :param spendable: energy that may be drawn [J]
    :param error: result, clipped, shape (6,)
    :param excess: written: by how much each limit has bitten
    :returns: energy drawn, and energy stored in the spring at the end [J]
    """
    follow(followed, wanted, jacobian, inertia, limits, dt, excess)
    potential(pose, followed, stiffness, clips[0], clips[1], error)
    given = wanted[STIFFNESS:STIFFNESS + 36]
    bound_stiffness(given, bounds[0], bounds[1], excess)
    drawn, short = _admit_stiffness(stiffness, given, error, change, spendable, excess)
    stiffness[:] = given
    moving, missing = _admit_reference(followed, pose, stiffness, clips, spendable - drawn, dt,
                                       error)
    if short + missing > 1e-12:
        excess[ENERGY] = short + missing
    _clipped(followed, pose, clips, error, excess)
    return drawn + moving, potential(pose, followed, stiffness, clips[0], clips[1], error)


@compiled
def _clipped(followed, pose, clips, error, excess):
    rotation_error(pose[3:7], followed[POSE + 3:POSE + 7], error[3:])
    far, turned = 0.0, 0.0
    for i in range(3):
        far += (followed[POSE + i] - pose[i]) ** 2
        turned += error[3 + i] ** 2
    excess[POSITION_ERROR] = max(math.sqrt(far) - clips[0], 0.0)
    excess[ROTATION_ERROR] = max(math.sqrt(turned) - clips[1], 0.0)


def stiffness_bounds(settings: LimitSettings) -> np.ndarray:
    """Return the bounds as `admit` takes them."""
    return np.array([np.diag(np.repeat(bound, 3)).reshape(-1)
                     for bound in (settings.stiffness_min, settings.stiffness_max)])


class EnergyTank:
    """
    Energy that may be given away.

    :ivar energy: content [J]
    """

    def __init__(self, settings: TankSettings, friction: np.ndarray):
        """:param friction: viscous, of the joints: dissipates for certain [Nm s/rad]"""
        self.settings = settings
        self._friction = friction
        self.energy = min(settings.energy, settings.capacity)
        self._before: tuple[np.ndarray, float, float] | None = None
        self._torque = np.zeros_like(friction)
        self._fall = 0.0

    def configure(self, settings: TankSettings) -> None:
        """Use other settings from now on; the content stays, as far as there is room for it."""
        self.settings = settings
        self.energy = min(self.energy, settings.capacity)

    def spendable(self, dt: float) -> float:
        """Energy that may be drawn in a tick [J]."""
        if not self.settings.passive:
            return math.inf
        return max(self.energy, 0.0) * min(1.0, dt / SPENDING_S)

    def valve(self) -> float:
        """Share of the feed-forward that may act: it closes with the last tenth of the energy."""
        if not self.settings.passive:
            return 1.0
        least = LEAST_SHARE * max(self.settings.energy, 1e-9)
        return min(max(self.energy, 0.0) / least, 1.0)

    def meter(self, measured: Measurement, stored: float, dt: float) -> None:
        """
        Draw what the last torque did between the last tick and this one.

        :param stored: in the spring now, with the target and stiffness of the last tick [J]
        """
        if not math.isfinite(stored + measured.potential + float(measured.velocity.sum())):
            self._before = None
        if self._before is not None:
            velocity, height, spring = self._before
            # With the mean velocity this is the change of kinetic energy, to rounding.
            work = 0.5 * dt * float(self._torque @ (velocity + measured.velocity))
            self._fall = measured.potential - height
            lost = 0.5 * dt * float(self._friction @ (velocity ** 2 + measured.velocity ** 2))
            self.draw(work - self._fall + stored - spring - lost)
        self.energy = min(self.energy + dt * self.settings.refill, self.settings.capacity)

    def draw(self, energy: float) -> None:
        """Draw energy [J]; negative: it comes back, and is lost where the tank is full."""
        if not math.isfinite(energy):
            self.forget()
            return
        self.energy = min(self.energy - energy, self.settings.capacity)

    def hold_back(self, measured: Measurement, torque: np.ndarray, spring_power: float,
                  dt: float) -> tuple[np.ndarray, float]:
        """
        Damp the joints by as much as a torque would draw beyond what there is.

        Whatever the reference and the stiffness do not explain (Coriolis compensation, null space,
        feed-forward, the clip) is met here.

        :param spring_power: rate at which the motion fills the spring [W]
        :returns: torque, and energy that the tank was short of in this tick [J]
        """
        velocity = measured.velocity
        drawing = dt * (float(velocity @ torque) + spring_power
                        - float(self._friction @ velocity ** 2)) - self._fall
        short = drawing - self.spendable(dt)
        moving = float(velocity @ velocity)
        if short <= 0.0 or moving < 1e-12:
            return torque, 0.0
        return torque - min(short / (dt * moving), MOST_DAMPING) * velocity, short

    def forget(self) -> None:
        """Start metering anew with an empty tank: what was drawn is not known."""
        self._before = None
        self.energy = 0.0

    def sent(self, measured: Measurement, torque: np.ndarray, stored: float) -> None:
        """Remember what is being sent, for `meter` to look at its effect."""
        self._before = (measured.velocity.copy(), measured.potential, stored)
        self._torque = torque.copy()


def growth_margin(times: np.ndarray, stiffness: np.ndarray, damping: np.ndarray,
                  inertia: np.ndarray) -> tuple[float, float]:
    """
    How far a stiffness profile is from being stable by itself, whatever the arm does.

    By Kronander and Billard, ``H ẍ + D ẋ + K x = 0`` with varying K and D is stable if for some α
    both ``α H - D`` and ``K̇ + α Ḋ - 2 α K`` are negative semidefinite.

    :param times: of the samples [s], shape ``(T,)``
    :param stiffness: shape ``(T, m, m)``
    :param damping: shape ``(T, m, m)``
    :param inertia: H, shape ``(m, m)``
    :returns: the best α [1/s], and the largest eigenvalue of the second matrix over the profile:
        stable if it is not positive
    """
    factor = np.linalg.inv(np.linalg.cholesky(inertia))
    most = float(np.linalg.eigvalsh(factor @ damping @ factor.T).min())
    growth, change = np.gradient(stiffness, times, axis=0), np.gradient(damping, times, axis=0)

    def worst(alpha: float) -> float:
        condition = growth + alpha * change - 2.0 * alpha * stiffness
        return float(np.linalg.eigvalsh(condition).max())

    alphas = np.geomspace(1e-3 * max(most, 1e-9), max(most, 1e-9), 200)
    values = [worst(alpha) for alpha in alphas]
    best = int(np.argmin(values))
    return float(alphas[best]), values[best]
