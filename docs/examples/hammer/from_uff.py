"""Modes of a universal file, data sets 55, by pyuff: reads `plate.unv`, writes `plate.csv`."""

import numpy as np
import pyuff

CONTACT, ACTUATOR, DIRECTION = 12, 14, "r3"  # two nodes; r1 is x, r2 is y, r3 is z
LENGTH, FORCE = 1000.0, 1.0  # units of the file in one m and one N: here mm and N

rows = []
for one in pyuff.UFF("plate.unv").read_sets():
    if one["type"] == 55 and one["analysis_type"] == 2:  # a normal mode
        shape = dict(zip(one["node_nums"], one[DIRECTION], strict=True))
        loss = one["modal_damp_his"] + 2 * one["modal_damp_vis"]
        mass_kg = one["modal_m"] * LENGTH / FORCE
        rows.append([one["freq"], loss, mass_kg, shape[CONTACT], shape[ACTUATOR]])
names = "frequency_hz,loss_factor,modal_mass_kg,shape_contact,shape_actuator"
np.savetxt("plate.csv", rows, "%.8g", ",", header=names, comments="")
