"""How good PPO's greedy policy is after every rollout on level 0, by an implementation that shares nothing with cpp-rl.

usage: jax_finals.py {ppo,ppo-eps,ppo-l2} FIRST_SEED SEEDS ROLLOUTS

Loss, networks and environment are those of jax_ppo.py and jax_common.py, optimisers are optax's. The loop is written again,
since that of jax_ppo.py, which is kept as it came, lets go of the parameters. Prints CSV: arm, seed, timesteps, the mean return
over all start cells, and the share of them that is solved.
"""
import sys

import jax
import jax.numpy as jnp
import optax
from jax_common import GAMMA, MAX_STEPS, STARTS, observe, reset, step
from jax_ppo import EPOCHS, MINIBATCHES, N_STEPS, forward, init_tower, loss, value

OPTIMIZERS = {
    "ppo": optax.adam(1e-4, eps=1e-5),
    "ppo-eps": optax.adam(1e-4, eps=1e-8),
    "ppo-l2": optax.adamw(1e-4, eps=1e-8, weight_decay=1e-4),
}


def evaluate(params):
    """Mean return and share solved of the greedy policy over all start cells."""

    def episode(cell):
        def advance(carry, _):
            state, total, over, solved = carry
            action = forward(params["pi"], observe(state[0], state[1])).argmax()
            _, state, reward, terminated, done = step(jax.random.key(0), state, action)
            return (state, total + jnp.where(over, 0.0, reward), over | done, solved | (terminated & ~over)), None

        state = (cell, jnp.zeros(64, bool).at[cell].set(True), 0)
        (_, total, _, solved), _ = jax.lax.scan(advance, (state, 0.0, False, False), None, MAX_STEPS)
        return total, solved

    totals, solved = jax.vmap(episode)(STARTS)
    return totals.mean(), solved.mean()


def train(key, rollouts, optimizer):
    """One seed, from nothing: `(mean return, share solved)` after each rollout's updates."""
    key_pi, key_vf, key_env, key = jax.random.split(key, 4)
    params = {"pi": init_tower(key_pi, 4, 0.01), "vf": init_tower(key_vf, 1, 1.0)}

    def act(carry, _):
        params, state, key = carry
        key, key_a, key_s = jax.random.split(key, 3)
        x = observe(state[0], state[1])
        logits = forward(params["pi"], x)
        action = jax.random.categorical(key_a, logits)
        state, final, reward, terminated, done = step(key_s, state, action)
        reward = reward + jnp.where(done & ~terminated, GAMMA * value(params, final), 0.0)
        return (params, state, key), (x, action, forward(params["vf"], x)[0], jax.nn.log_softmax(logits)[action], reward, done)

    def update(carry, _):
        params, opt, state, key = carry
        (_, state, key), (x, action, v, logp, reward, done) = jax.lax.scan(act, (params, state, key), None, N_STEPS)

        def gae(carry, t):
            adv, next_v = carry
            v, r, d = t
            adv = r + GAMMA * next_v * (1 - d) - v + GAMMA * 0.95 * (1 - d) * adv
            return (adv, v), adv

        _, adv = jax.lax.scan(gae, (0.0, value(params, state)), (v, reward, done.astype(jnp.float32)), reverse=True)
        data = (x, action, logp, adv, adv + v)

        def minibatch(carry, batch):
            params, opt = carry
            delta, opt = optimizer.update(jax.grad(loss)(params, batch), opt, params)
            return (optax.apply_updates(params, delta), opt), None

        def epoch(carry, _):
            params, opt, key = carry
            key, key_p = jax.random.split(key)
            order = jax.random.permutation(key_p, N_STEPS)
            batches = jax.tree.map(lambda t: t[order].reshape((MINIBATCHES, -1) + t.shape[1:]), data)
            (params, opt), _ = jax.lax.scan(minibatch, (params, opt), batches)
            return (params, opt, key), None

        (params, opt, key), _ = jax.lax.scan(epoch, (params, opt, key), None, EPOCHS)
        return (params, opt, state, key), evaluate(params)

    return jax.lax.scan(update, (params, optimizer.init(params), reset(key_env), key), None, rollouts)[1]


def main():
    arm, (first, seeds, rollouts) = sys.argv[1], map(int, sys.argv[2:])
    optimizer = optax.chain(optax.clip_by_global_norm(0.5), OPTIMIZERS[arm])
    program = jax.jit(lambda key: train(key, rollouts, optimizer))
    for seed in range(first, first + seeds):
        means, solved = jax.block_until_ready(program(jax.random.key(seed)))
        for rollout, (mean, share) in enumerate(zip(means.tolist(), solved.tolist()), 1):
            print(f"{arm},{seed},{rollout * N_STEPS},{mean:.4f},{share:.6f}", flush=True)


if __name__ == "__main__":
    main()
