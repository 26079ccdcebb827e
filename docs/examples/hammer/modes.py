"""Modes of a structure from hits of an impact hammer, by sdypy-EMA: writes `modes.csv`."""

import numpy as np
from sdypy import EMA

RATE_HZ, WINDOW_S, ORDER = 25600, 0.006, 60


def spectra(kind):
    hits = np.array(
        [np.loadtxt(f"{kind}{i}.csv", delimiter=",", skiprows=1)[:, 1] for i in (1, 2, 3)]
    )
    hits -= hits[:, :16].mean(axis=1, keepdims=True)  # offset at rest
    return np.fft.rfft(hits * np.exp(-np.arange(hits.shape[1]) / RATE_HZ / WINDOW_S), 4096)


force, motion = spectra("f"), spectra("a")
response = np.sum(motion * force.conj(), axis=0) / np.sum(np.abs(force) ** 2, axis=0)
hz = np.fft.rfftfreq(4096, 1 / RATE_HZ)
model = EMA.Model(response, hz, lower=300, upper=7950, pol_order_high=ORDER, frf_form="accelerance")
model.get_poles(show_progress=False)

# Stable poles: the order below has them too, within 0.1 % of the frequency and 10 % of the damping.
(below_hz, found_hz), (below_xi, xi) = model.pole_freq[-2:], model.pole_xi[-2:]
near = [np.argmin(np.abs(below_hz - one)) for one in found_hz]
stable = (np.abs(below_hz[near] / found_hz - 1) < 1e-3) & (np.abs(below_xi[near] / xi - 1) < 0.1)
stable &= (model.all_poles[-1].imag > 0) & (xi > 0) & (found_hz > 300) & (found_hz < 7950)
model.pole_ind = [(ORDER - 1, i) for i in np.flatnonzero(stable)]
fitted, constants = model.get_constants()

omega = 2 * np.pi * found_hz[stable]
loss = 2 * (xi[stable] - 1 / (omega * WINDOW_S))  # without the damping of the window
product = -2 * omega * constants[0].imag  # shape at the hit times shape at the sensor, 1/kg
size = np.sqrt(np.abs(product))
rows = [
    omega / (2 * np.pi),
    np.maximum(loss, 2e-4),
    np.ones(len(omega)),
    size,
    np.sign(product) * size,
]
names = "frequency_hz,loss_factor,modal_mass_kg,shape_contact,shape_sensor"
np.savetxt(
    "modes.csv", np.transpose(rows)[np.argsort(omega)], "%.8g", ",", header=names, comments=""
)
band = (hz > 400) & (hz < 7900)
left = np.linalg.norm((fitted[0] - response[: fitted.shape[1]])[band[: fitted.shape[1]]])
print(f"{len(omega)} modes, misfit {100 * left / np.linalg.norm(response[band]):.1f} %")
