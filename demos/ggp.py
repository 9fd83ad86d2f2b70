# SPDX-License-Identifier: MIT
"""The demo of ``ggp.toml`` from Python: the posterior genioglossus pulls the root of the tongue forward."""

import tongue_fenicsx as tf

tongue = tf.parametric_tongue().mesh(size=6.4e-3)
model = tf.Model(tongue, tissue=tf.Tissue.calka())
run = tf.Simulation(model).run({"GGP": tf.ramp(rise=0.1, hold=0.25)}, t_end=0.35, output="runs/ggp_python")
run.plot("trajectories")

advance = -1e3 * run.probes["root"][-1, 0]
print(f"the root moved {advance:.1f} mm forward")
assert 3 < advance < 15
