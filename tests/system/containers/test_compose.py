"""``docker compose up sim`` and its relatives, on a real engine."""

from __future__ import annotations

import http.client
import json
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import pytest

from services.cell.hil import FULL_SCALES

EPISODES = 24
"""More than there are between two checkpoints."""
SERVICES = ("router", "store", "task", "classifier", "agent", "viewer", "sim")
CONTAINERS = (*SERVICES, "viewer-front")
PATIENCE_S = 30.0
BASE = "debian:bookworm-slim"
MOST_ABOVE_BASE = 250_000_000
SUITE = "suite-round"
Docker: TypeAlias = Callable[..., str]


def test_one_command_brings_up_a_cell_that_survives_and_resumes(
    composition: Any, docker: Docker, reference: Callable[..., dict[str, str]], wait_until: Callable[..., None]
) -> None:
    def health(service: str) -> str:
        return str(_state(docker, composition.containers(service)[0])["Health"]["Status"])

    composition("up", "--detach", "sim", EPISODES=EPISODES, SEED=1)
    wait_until("it learns", lambda: "return(10)" in composition.logs("sim"))
    for service in ("agent", "classifier", "sim", "store", "router", "task"):
        composition.kill(service)
    assert composition.digests(EPISODES) == reference(EPISODES, 1)
    assert f"episode {EPISODES}/{EPISODES}" in composition.logs("sim")
    wait_until("all are healthy", lambda: all(health(name) == "healthy" for name in CONTAINERS))
    containers = {name: composition.containers(name)[0] for name in CONTAINERS}
    composition("stop")
    for name, container in containers.items():
        assert _state(docker, container)["ExitCode"] == 0, f"{name} had to be killed"
    composition("down")
    composition("up", "--detach", "sim", EPISODES=EPISODES + 6, SEED=1)
    assert composition.digests(EPISODES + 6) == reference(EPISODES + 6, 1)
    assert f"goes on with episode {EPISODES}" in composition.logs("task")


def test_a_fleet_is_so_many_cells(composition: Any, reference: Callable[..., dict[str, str]]) -> None:
    composition.profile = "fleet"
    composition("up", "--detach", CELLS=2, EPISODES=6, SEED=3)
    assert len(composition.containers("agent")) == 2
    assert len(composition.containers("store")) == len(composition.containers("router")) == 1
    for place in range(2):
        assert composition.digests(6, str(place + 1)) == reference(6, 3 + place)


def test_a_secured_cell_learns_the_same_and_shuts_strangers_out(
    composition: Any, docker: Docker, reference: Callable[..., dict[str, str]], tmp_path: Path
) -> None:
    composition.profile, composition.certs = "secure", tmp_path / "certs"
    composition.certs.mkdir()
    composition("up", "--detach", EPISODES=8, SEED=2)
    assert composition.digests(8) == reference(8, 2)
    (agent,) = composition.containers("secure-agent")
    seen = docker("exec", agent, "sh", "-c", "cd /certs && echo *").split()
    assert seen == ["ca.pem", "cert.pem", "key.pem"], "no container sees another's key"
    composition.certs = None
    refused = composition.get("experiment")
    assert (refused.returncode, refused.stdout) == (2, "")


def test_through_emulated_hardware_a_cell_learns_the_same(
    composition: Any, reference: Callable[..., dict[str, str]]
) -> None:
    composition.profile = "hil"
    composition("up", "--detach", EPISODES=4, SEED=1)
    assert composition.digests(4) == reference(4, 1, *FULL_SCALES, "start.decimals=4")
    assert len(composition.containers("robot_link")) == len(composition.containers("sensor_jr3")) == 1


@pytest.mark.parametrize(
    ("profile", "parts"),
    [("ur", ("robot_ur", "ur-controller")), ("ros2", ("ros2_robot", "ros2_sensor"))],
    ids=["universal-robots", "topics-of-ros2"],
)
def test_through_an_emulated_arm_the_suite_s_task_is_learnt_the_same(
    profile: str, parts: Sequence[str], composition: Any, reference: Callable[..., dict[str, str]]
) -> None:
    composition.profile = profile
    composition("up", "--detach", EPISODES=3, SEED=1, EXPERIMENT=SUITE)
    assert composition.digests(3) == reference(3, 1, *FULL_SCALES, "start.decimals=4", experiment=SUITE)
    assert [len(composition.containers(part)) for part in parts] == [1, 1]


def test_containers_are_given_no_more_than_they_need(composition: Any, docker: Docker) -> None:
    composition("up", "--detach", "sim", EPISODES=2)
    for name in CONTAINERS:
        (container,) = composition.containers(name)
        (told,) = json.loads(docker("inspect", container))
        assert told["Config"]["User"] == "10001:10001"
        assert told["HostConfig"]["ReadonlyRootfs"] is True
        assert told["HostConfig"]["CapDrop"] == ["ALL"]
        assert told["HostConfig"]["RestartPolicy"]["Name"] == "unless-stopped"
        assert told["Config"]["Healthcheck"]["Test"]


def test_readers_read_and_nobody_else_draws(composition: Any, wait_until: Callable[..., None], tmp_path: Path) -> None:
    composition("up", "--detach", "sim", EPISODES=200)
    url = f"rerun+http://127.0.0.1:{composition.ports['RERUN_PORT']}/proxy"
    wait_until("it learns", lambda: "return(10)" in composition.logs("sim"))
    draw = (
        "import sys, rerun as rr; stream = rr.RecordingStream('treenail', recording_id='forged')\n"
        "stream.connect_grpc(sys.argv[1]); stream.log('forged/by_stranger', rr.Scalars(1.0)); stream.flush()"
    )
    subprocess.run([sys.executable, "-c", draw, url], capture_output=True, check=False, timeout=PATIENCE_S)
    seen = tmp_path / "seen.rrd"
    reader = subprocess.Popen(
        [sys.executable, "-m", "rerun", url, "--save", str(seen), "--port", "0"],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        wait_until("who looks on sees the cell", lambda: seen.exists() and b"progress/return" in seen.read_bytes())
    finally:
        reader.kill()
        reader.wait()
    assert b"by_stranger" not in seen.read_bytes()
    service = "/rerun.sdk_comms.v1alpha1.MessageProxyService"
    told = {"Content-Type": "application/grpc-web+proto", "X-Grpc-Web": "1"}
    answers = {}
    for method in ("ReadMessages", "WriteMessages"):
        page = http.client.HTTPConnection("127.0.0.1", composition.ports["WEB_PORT"], timeout=PATIENCE_S)
        page.request("POST", f"{service}/{method}", body=b"\0\0\0\0\0", headers=told)
        answer = page.getresponse()
        answers[method] = (answer.status, len(answer.read(1000)) == 1000)
        page.close()
    assert answers == {"ReadMessages": (200, True), "WriteMessages": (405, False)}


@pytest.mark.parametrize("service", ["agent", "classifier"])
def test_workers_are_small(docker: Docker, service: str) -> None:
    sizes = [json.loads(docker("image", "inspect", image))[0]["Size"] for image in (f"treenail/{service}", BASE)]
    assert sizes[0] - sizes[1] < MOST_ABOVE_BASE


@pytest.mark.parametrize("service", SERVICES)
def test_only_who_needs_it_carries_it(docker: Docker, service: str) -> None:
    look = "import importlib.util as u; print(*(n for n in ('sapien', 'rerun', 'numba') if u.find_spec(n)))"
    found = docker("run", "--rm", "--entrypoint", "python3", f"treenail/{service}", "-c", look).split()
    assert found == {"sim": ["sapien"], "viewer": ["rerun"]}.get(service, [])


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (("--tmpfs", "/data:ro"), "Read-only file system"),
        (("--tmpfs", "/data:size=8k,uid=10001"), "full"),
    ],
    ids=["read-only", "full"],
)
def test_a_volume_that_cannot_be_written_is_one_line(options: tuple[str, ...], expected: str) -> None:
    command = ["docker", "run", "--rm", "--network", "none", *options, "treenail/store"]
    done = subprocess.run(
        [*command, "store", "--file", "/data/store.sqlite"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert line.startswith("treenail store: store: ")
    assert expected in line


def _state(docker: Docker, container: str) -> dict[str, Any]:
    state: dict[str, Any] = json.loads(docker("inspect", container))[0]["State"]
    return state
