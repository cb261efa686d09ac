"""Learn a residual policy for the task csa-slew: python docs/examples/learn_residual.py FOLDER

An evolution strategy that adapts its covariance (CMA-ES: Hansen 2016, arXiv:1604.00772) in NumPy:
each generation flies its candidates on the same members of the task, side by side. The policy adds
up to a fifth of the limits to PD + feedforward: action = tanh(W o), o the scaled observation.
Writes policy.onnx, policy.npz and curve.json.
"""

import json
import sys
from pathlib import Path
from time import perf_counter

import numpy as np

from flexslew_lab.benchmark.task import development_seeds, load_task
from flexslew_lab.gym.vector import VectorSlew

TASK, SEED = "csa-slew", 1
SETTINGS = {"base": {"kp": [460.0, 460.0], "kd": [920.0, 920.0]}, "authority": 0.2}
CANDIDATES, MEMBERS, GENERATIONS = 40, 16, 60  # members: on which each candidate is flown
SPREAD = 0.1  # of the first candidates
SCALE = {"error": 50.0, "error_rate": 100.0, "tip": 0.05, "applied": 0.3, "feedforward": 0.3}


def scales(signals: tuple[str, ...]) -> np.ndarray:
    """Return the factor of each entry of an observation, by the kind of its signal."""
    return np.array([SCALE[name.partition(".")[0]] for name in signals])


def scores(env: VectorSlew, policies: np.ndarray, members: list[int]) -> np.ndarray:
    """Return the mean score of each policy on the same members, shape (policies,)."""
    count, joints = len(policies), env.single_action_space.shape[0]
    weights = policies.reshape(count, -1, joints)
    factors = scales(env.signals)
    observed, _ = env.reset(options={"member": members * count})
    while True:
        o = (observed * factors).reshape(count, len(members), -1)
        actions = np.tanh(o @ weights).reshape(-1, joints)
        observed, _, _, over, info = env.step(actions)
        if over.all():
            return info["score"].reshape(count, -1).mean(axis=1)


def learn(env: VectorSlew, rng: np.random.Generator) -> tuple[np.ndarray, list[float]]:
    """Return the policy, flat, and the mean score of each generation; symbols as in the paper."""
    n = len(env.signals) * env.single_action_space.shape[0]
    mu = CANDIDATES // 2
    w = np.log(mu + 0.5) - np.log(np.arange(1, mu + 1))
    w /= w.sum()
    mu_eff = 1.0 / (w**2).sum()
    c_s, c_c = (mu_eff + 2) / (n + mu_eff + 5), (4 + mu_eff / n) / (n + 4 + 2 * mu_eff / n)
    d_s, c_1 = 1 + c_s, 2 / ((n + 1.3) ** 2 + mu_eff)
    c_mu = min(1 - c_1, 2 * (mu_eff - 2 + 1 / mu_eff) / ((n + 2) ** 2 + mu_eff))
    expected = np.sqrt(n) * (1 - 1 / (4 * n) + 1 / (21 * n**2))
    m, sigma, p_s, p_c, c = np.zeros(n), SPREAD, np.zeros(n), np.zeros(n), np.eye(n)
    curve = []
    for generation in range(GENERATIONS):
        started = perf_counter()
        d2, b = np.linalg.eigh(c)
        d = np.sqrt(d2)
        y = (rng.standard_normal((CANDIDATES, n)) * d) @ b.T
        members = rng.integers(1 << 31, size=MEMBERS).tolist()
        found = scores(env, m + sigma * y, members)
        best = y[np.argsort(-found)[:mu]]
        step = w @ best
        m = m + sigma * step
        p_s = (1 - c_s) * p_s + np.sqrt(c_s * (2 - c_s) * mu_eff) * (b @ ((b.T @ step) / d))
        p_c = (1 - c_c) * p_c + np.sqrt(c_c * (2 - c_c) * mu_eff) * step
        c = (1 - c_1 - c_mu) * c + c_1 * np.outer(p_c, p_c) + c_mu * (best.T * w) @ best
        sigma *= float(np.exp(c_s / d_s * (np.linalg.norm(p_s) / expected - 1)))
        curve.append(float(found.mean()))
        words = f"{generation:3} score {curve[-1]:6.2f}, best {found.max():6.2f}, sigma {sigma:.3f}"
        print(f"{words}  {perf_counter() - started:.1f} s", flush=True)
    return m, curve


def save_onnx(policy: np.ndarray, signals: tuple[str, ...], joints: int, path: Path) -> None:
    """Write the policy as an ONNX model, which the law `policy` flies."""
    import onnx
    from onnx import TensorProto, helper, numpy_helper

    scaled = scales(signals)[:, None] * policy.reshape(-1, joints)
    numbers = [numpy_helper.from_array(scaled.astype(np.float32), "W")]
    nodes = [
        helper.make_node("MatMul", ["observation", "W"], ["sum"]),
        helper.make_node("Tanh", ["sum"], ["action"]),
    ]
    inside = helper.make_tensor_value_info("observation", TensorProto.FLOAT, ["N", len(signals)])
    outside = helper.make_tensor_value_info("action", TensorProto.FLOAT, ["N", joints])
    graph = helper.make_graph(nodes, "policy", [inside], [outside], numbers)
    opset = [helper.make_opsetid("", 17)]
    onnx.save(helper.make_model(graph, opset_imports=opset, ir_version=9), path)


def main(folder: Path) -> None:
    """Learn, and compare with PD + feedforward on the development seeds."""
    folder.mkdir(parents=True, exist_ok=True)
    env, started = VectorSlew(CANDIDATES * MEMBERS, TASK, **SETTINGS), perf_counter()
    policy, curve = learn(env, np.random.default_rng(SEED))
    seeds = list(development_seeds(load_task(TASK)))
    both = np.stack((np.zeros_like(policy), policy))
    baseline, learned = scores(VectorSlew(2 * len(seeds), TASK, **SETTINGS), both, seeds)
    print(f"PD + feedforward {baseline:.2f}, with the policy {learned:.2f}")
    joints = env.single_action_space.shape[0]
    save_onnx(policy, env.signals, joints, folder / "policy.onnx")
    np.savez(folder / "policy.npz", policy=policy)
    summary = {"curve": curve, "baseline": baseline, "learned": learned}
    (folder / "curve.json").write_text(json.dumps(summary, indent=1) + "\n")
    print(f"{perf_counter() - started:.0f} s")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "runs/learned"))
