"""The campaign in diffrax."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import diffrax
import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.engine import cylinder
from benchmarks.engine.common import Floats, equations, shown


class DiffraxPeer:
    """Kvaerno3 on all records at once, with forward-mode derivatives.

    Without the maximum step `dtmax` the derivatives are NaN although the outputs are right.
    """

    packages = ("diffrax", "jax")

    def __init__(self) -> None:
        jax.config.update("jax_enable_x64", True)
        self.system = cylinder.build()
        records = cylinder.campaign()
        self.initial = jnp.stack([record.initial for record in records])
        self.inputs = jnp.stack([record.inputs for record in records])
        self.nominal = jnp.array(self.system.nominal)
        names: dict[str, Any] = {"exp": jnp.exp, "log": jnp.log, "sqrt": jnp.sqrt, "tanh": jnp.tanh}
        names["stack"] = lambda *terms: jnp.stack(terms)
        exec(equations(self.system, "stack({})"), names)
        self.rhs = names["rhs"]
        self.sizes = jnp.array([100.0 * state.scale for state in self.system.states])
        self.run = jax.jit(self._campaign)
        self.slopes: dict[tuple[str, ...], Any] = {}

    def simulate(self) -> Floats:
        return np.asarray(self.run(self.nominal))

    def jacobian(self, columns: Sequence[str]) -> Floats:
        key = tuple(columns)
        places = jnp.array([self.system.parameter_names.index(name) for name in key])
        scale = jnp.array([cylinder.PARAMETERS[name][2] for name in key])
        if key not in self.slopes:
            moved = lambda p: self._campaign(self.nominal.at[places].add(p * scale))  # noqa: E731
            self.slopes[key] = jax.jit(jax.jacfwd(moved))
        return np.asarray(self.slopes[key](jnp.zeros(len(key))) / scale)

    def _campaign(self, q: Any) -> Any:
        states = jax.vmap(self._record, in_axes=(0, 0, None))(self.initial, self.inputs, q)
        return shown(self.system, states, q[7])

    def _record(self, initial: Any, inputs: Any, q: Any) -> Any:
        y, pieces = initial / self.sizes, [(initial / self.sizes)[None]]
        term = diffrax.ODETerm(lambda t, y, args: self.rhs(y * self.sizes, args[0], args[1]) / self.sizes)
        control = diffrax.PIDController(rtol=1e-5, atol=1e-6, dtmax=0.05)
        for phase, (seconds, _) in enumerate(cylinder.SEGMENTS):
            grid = jnp.arange(1, round(seconds * cylinder.RATE) + 1) / cylinder.RATE
            found = diffrax.diffeqsolve(
                term,
                diffrax.Kvaerno3(),
                0.0,
                seconds,
                1e-4,
                y,
                (inputs[phase], q),
                saveat=diffrax.SaveAt(ts=grid),
                stepsize_controller=control,
                adjoint=diffrax.DirectAdjoint(),
                max_steps=8192,
            )
            pieces.append(found.ys)
            y = found.ys[-1]
        return jnp.concatenate(pieces) * self.sizes
