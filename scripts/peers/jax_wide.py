"""Throughput of the JAX programs beside it with two hidden layers of another width. usage: jax_wide.py ppo|dqn WIDTH UNITS

One seed; UNITS are rollouts of 2,048 timesteps (PPO) or timesteps (DQN). Prints what jax_ppo.py and jax_dqn.py print.
"""

import sys

import jax
import jax.numpy as jnp
import jax_dqn
import jax_ppo


def main():
    algo, width, units = sys.argv[1], int(sys.argv[2]), sys.argv[3]

    def init_tower(key, outputs, gain):
        sizes, gains = [256, width, width, outputs], [2**0.5, 2**0.5, gain]
        keys = jax.random.split(key, 3)
        layers = zip(keys, gains, sizes, sizes[1:])
        return [(jax.nn.initializers.orthogonal(g)(k, (i, o)), jnp.zeros(o)) for k, g, i, o in layers]

    def init(key):
        sizes = [256, width, width, 4]
        layers = zip(jax.random.split(key, 3), sizes, sizes[1:])
        uniform = jax.random.uniform
        return [(uniform(k, (i, o), minval=-(i**-0.5), maxval=i**-0.5), jnp.zeros(o)) for k, i, o in layers]

    program = {"ppo": jax_ppo, "dqn": jax_dqn}[algo]
    jax_ppo.init_tower, jax_dqn.init = init_tower, init
    sys.argv[1:] = ["1", units]
    program.main()


if __name__ == "__main__":
    main()
