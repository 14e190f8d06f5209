"""Random-phase multisine and the frequency response that it measures: best linear approximation, noise and distortion.

What            a periodic signal of chosen lines with random phases. P periods of M realisations separate what changes from
                period to period (noise) from what changes with the phases (non-linear distortion)
Equation        u(t) = sum_k A cos(2 pi k t/T + phi_k), phi_k uniform
                G_m = (mean_p Y)/(mean_p U);  G = mean_m G_m, the best linear approximation
                var_n(G_m) = sum_p |(Y - mean_p Y) - G (U - mean_p U)|^2/(P (P - 1) |mean_p U|^2)
                var(G) = sum_m |G_m - G|^2/(M (M - 1)),  var_n(G) = mean_m var_n(G_m)/M
                var_s = M max(0, var - var_n), distortion of one realisation
                with a reference R: G = mean_m(Y/R)/mean_m(U/R), where feedback makes U depend on Y
                coherence |sum Y U*|^2/(sum |U|^2 sum |Y|^2) over all periods of all realisations
Assumptions     the system answers a period with the same period after the transient; integer periods, so there is no leakage
Valid range     M of 2 or more for the distortion, P of 2 or more for the noise
Not modelled    transient: leave out the first period
References      Pintelon & Schoukens, System Identification: A Frequency Domain Approach, 2nd ed. 2012, ch. 4 (robust method);
                Janssens 2010, sec. 3.10 (M = 4, P = 10, 500 Hz)
"""

from dataclasses import dataclass

import numpy as np

from plant_sim.friction.model import check_real, require
from plant_sim.friction.whole_number import require_whole
from protocols.errors import InputError

Array = np.ndarray


@dataclass(frozen=True)
class Multisine:
    """Lines `lines` (integers, cycles a period) with equal `amplitude` in a period of `samples` samples. Raises InputError."""

    lines: Array
    amplitude: float
    samples: int

    def __post_init__(self) -> None:
        require_whole("samples of a period", self.samples)
        lines = np.asarray(self.lines)
        if lines.ndim != 1 or lines.size == 0 or not np.issubdtype(lines.dtype, np.integer):
            raise InputError("lines of a multisine must be a list of one or more whole numbers")
        if not (lines.min() >= 1 and 2 * lines.max() < self.samples):
            raise InputError(
                f"lines of the multisine run from {lines.min()} to {lines.max()}; allowed is 1 to less than half of"
                f" the {self.samples} samples of a period"
            )
        require("amplitude of the multisine", self.amplitude, least=0.0, most=1e12)

    def draw_period(self, random: np.random.Generator) -> Array:
        """Return one period (samples,) with phases drawn from `random`."""
        spectrum = np.zeros(self.samples // 2 + 1, complex)
        phases = random.uniform(0.0, 2.0 * np.pi, self.lines.size)
        spectrum[self.lines] = 0.5 * self.samples * self.amplitude * np.exp(1j * phases)
        return np.fft.irfft(spectrum, self.samples)

    def frequency(self, dt: float) -> Array:
        """Return the lines [Hz] for samples `dt` [s] apart."""
        return self.lines / (self.samples * dt)


@dataclass(frozen=True)
class FrequencyResponse:
    """Best linear approximation at `frequency` [Hz] (n,) with its standard deviations (n,), all in output over input."""

    frequency: Array
    response: Array  # complex
    deviation: Array  # of `response`, noise and distortion together
    noise: Array  # of `response`, noise alone
    distortion: Array  # of one realisation, non-linear distortion alone; 0 where noise hides it


def estimate_response(
    source: Multisine, dt: float, inputs: Array, outputs: Array, reference: Array | None = None
) -> FrequencyResponse:
    """Return the response from `inputs` to `outputs`, (M, P, samples): M realisations of P periods each.

    reference: (M, samples), the multisine itself, where feedback makes the input depend on the output. Raises InputError.
    """
    inputs, outputs = check_real("inputs", inputs), check_real("outputs", outputs)
    if inputs.shape != outputs.shape or inputs.ndim != 3 or inputs.shape[2] != source.samples:
        raise InputError(
            f"inputs have shape {inputs.shape} and outputs {outputs.shape}; both must be (realisations, periods,"
            f" {source.samples})"
        )
    realisations, periods, _ = inputs.shape
    if realisations < 2 or periods < 2:
        raise InputError(
            f"there are {realisations} realisations of {periods} periods; at least 2 of 2 are needed to separate"
            " noise from distortion"
        )
    u = np.fft.rfft(inputs)[..., source.lines] / source.samples
    y = np.fft.rfft(outputs)[..., source.lines] / source.samples
    mean_u, mean_y = u.mean(axis=1), y.mean(axis=1)
    turn = np.ones_like(mean_u) if reference is None else np.fft.rfft(reference)[:, source.lines] / source.samples
    single = mean_y / mean_u
    if reference is None:
        response = single.mean(axis=0)
        spread = single - response
    else:
        to_output, to_input = (mean_y / turn).mean(axis=0), (mean_u / turn).mean(axis=0)
        response = to_output / to_input
        spread = (mean_y / turn - response * (mean_u / turn)) / to_input  # linearised about the mean
    rest = (y - mean_y[:, None]) - response * (u - mean_u[:, None])  # what a period adds to Y - G U
    scale = np.abs(mean_u) ** 2 * periods * (periods - 1)
    noise = (np.abs(rest) ** 2).sum(axis=1) / scale  # variance of each realisation
    total = (np.abs(spread) ** 2).sum(axis=0) / (realisations * (realisations - 1))
    noise_of_mean = noise.mean(axis=0) / realisations
    return FrequencyResponse(
        frequency=source.frequency(dt),
        response=response,
        deviation=np.sqrt(total),
        noise=np.sqrt(noise_of_mean),
        distortion=np.sqrt(realisations * np.maximum(total - noise_of_mean, 0.0)),
    )


def compute_coherence(source: Multisine, inputs: Array, outputs: Array) -> Array:
    """Return the coherence (n,) [-] of inputs and outputs as for `estimate_response`.

    It is 1 where the whole output follows from the input.
    """
    u, y = (np.fft.rfft(signal)[..., source.lines] for signal in (inputs, outputs))
    cross = np.sum(y * u.conj(), axis=(0, 1))
    powers = np.sum(np.abs(u) ** 2, axis=(0, 1)) * np.sum(np.abs(y) ** 2, axis=(0, 1))
    return np.abs(cross) ** 2 / powers
