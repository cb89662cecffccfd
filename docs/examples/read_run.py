"""Read a run into pandas: how returns, forces and failures go, ten episodes at a time."""

import sys

import pandas

folder = sys.argv[1] if len(sys.argv) > 1 else "runs/mine"
episodes = pandas.read_csv(f"{folder}/episodes.csv")
episodes["inserted"] = episodes["outcome"] == "inserted"
blocks = episodes.groupby(["seed", episodes["episode"] // 10])
print(blocks[["return", "mean_force_n", "peak_force_n", "inserted"]].mean().round(2))
