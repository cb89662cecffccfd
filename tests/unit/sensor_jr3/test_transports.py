"""Ways to a card: URLs with their reasons, the compiled helper, and a real bus without a card."""

from __future__ import annotations

import platform
import shutil
import subprocess
import sys
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import pytest

from services.rules.settings import SettingError
from services.sensor_jr3 import build_port, transports
from services.sensor_jr3.card import NoCardError, Sample, UrlError
from services.sensor_jr3.driver import Driver, Setup
from services.sensor_jr3.isa import IsaCard
from services.sensor_jr3.settings import Settings, whole_numbers

X86 = platform.machine() in build_port.MACHINES and sys.platform == "linux"
needs_compiler = pytest.mark.skipif(not X86 or shutil.which("cc") is None, reason="needs Linux on x86 and cc")
FAKE_BUS = Path(__file__).with_name("fake_bus")


@pytest.mark.parametrize("url", ["isa:0x260", "isa:608", "tcp://127.0.0.1:7460", "tcp://[::1]:7460", "TCP://Host-1:1"])
def test_a_way_to_a_card_is_taken(url: str) -> None:
    transports.check(url)


@pytest.mark.parametrize(
    ("url", "message"),
    [
        ("", "expected isa:0x260 or tcp://host:port"),
        ("isa:", "expected isa:0x260"),
        ("isa:0608", "expected isa:0x260"),
        ("isa:\u0666\u0660\u0668", "expected isa:0x260"),
        ("tcp://host:\u0661", "expected tcp://host:port"),
        ("isa:0x20", "a base of 0x100 to 0x3fc, a multiple of 4, got 0x20"),
        ("isa:0x261", "a multiple of 4"),
        ("isa:0x1000", "a base of"),
        ("tcp://host", "expected tcp://host:port"),
        ("tcp://host:70000", "expected tcp://host:port"),
        ("tcp://a b:1", "expected tcp://host:port"),
        ("comedi:/dev/comedi0", "without sample counters and error bits"),
        ("/dev/comedi0", "without sample counters and error bits"),
        ("jr3:/dev/jr3", "the character device of jr3pci-linux gives filtered values only"),
        ("/dev/jr3", "without sample counters and error bits"),
        ("/dev/port", "byte-wide cycles"),
        ("pci:0", "firmware that is not public"),
        ("http://host", "expected isa:0x260"),
    ],
)
def test_another_way_is_refused_with_the_reason(url: str, message: str) -> None:
    with pytest.raises(UrlError, match=message):
        transports.check(url)


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build_port.build(tmp_path_factory.mktemp("helper") / "jr3_port.so")


@pytest.fixture
def empty_bus(library: Path) -> Iterator[IsaCard]:
    try:
        card = IsaCard(0x260, library)
    except SettingError as error:
        pytest.skip(str(error))
    yield card
    card.close()


@needs_compiler
def test_a_bus_without_a_card_really_reads_ffff_and_is_named(empty_bus: IsaCard) -> None:
    assert empty_bus.read(0xF5, 4) == [0xFFFF] * 4
    with pytest.raises(NoCardError, match="got FFFF everywhere"):
        next(Driver(empty_bus, Setup()).start())


@needs_compiler
def test_a_bus_without_a_card_gives_no_samples(empty_bus: IsaCard) -> None:
    for counter in (0xE8, 0xEA):
        assert empty_bus.collect(counter, 0x90, 0.002) == ([], 0.0)


@pytest.fixture(scope="module")
def fake_bus(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The helper, compiled against a bus that has a card."""
    made = tmp_path_factory.mktemp("fake") / "jr3_port.so"
    flags = ["-O2", "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC", "-pthread", "-I", str(FAKE_BUS)]
    subprocess.run(["cc", *flags, "-o", str(made), str(build_port.SOURCE)], check=True, capture_output=True)
    return made


@needs_compiler
def test_the_helper_reads_and_writes_through_address_and_data_port(fake_bus: Path) -> None:
    card = IsaCard(0x260, fake_bus)
    for value, at in enumerate(range(0x80, 0x86), start=0xFFFC):
        card.write(at, value & 0xFFFF)
    assert card.read(0x80, 6) == [0xFFFC, 0xFFFD, 0xFFFE, 0xFFFF, 0, 1]


@needs_compiler
def test_the_helper_finds_no_card_at_another_base(fake_bus: Path) -> None:
    with pytest.raises(NoCardError, match="got FFFF everywhere"):
        next(Driver(IsaCard(0x280, fake_bus), Setup()).start())


@needs_compiler
def test_ports_that_are_not_given_are_named_in_one_line(fake_bus: Path) -> None:
    with pytest.raises(SettingError, match="isa:0x300: expected root or CAP_SYS_RAWIO"):
        IsaCard(0x300, fake_bus)


@needs_compiler
@pytest.mark.parametrize(("counter", "data", "wanted"), [(0xE8, 0x90, 4000), (0xEA, 0xA8, 100)])
def test_the_helper_takes_each_sample_once_and_whole(fake_bus: Path, counter: int, data: int, wanted: int) -> None:
    card = IsaCard(0x260, fake_bus)
    card.write(0xF0, 3)
    card.write(0xF1, 5)
    samples: list[Sample] = []
    try:
        while len(samples) < wanted:
            found = card.collect(counter, data, 1.0)
            assert found.newest_s < 1.5, "no sample is newer than the end of the call"
            samples += found.samples
    finally:
        card.close()
    # How many it may miss depends on the machine; that none is torn or comes twice does not.
    steps = [(after.counter - before.counter) % 65536 for before, after in pairwise(samples)]
    assert min(steps) >= 1
    assert max(steps) < 32768
    for sample in samples:
        assert {count % 65536 for count in sample.counts} == {sample.counter}
        assert (sample.warnings, sample.errors) == (3, 5)


@needs_compiler
def test_a_card_without_its_helper_says_how_to_build_it(tmp_path: Path) -> None:
    with pytest.raises(SettingError, match=r"build it: python -m services\.sensor_jr3\.build_port"):
        IsaCard(0x260, tmp_path / "none.so")


@needs_compiler
def test_without_a_compiler_it_says_what_is_needed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(SettingError, match=r"expected a C compiler \(cc\), got none"):
        build_port.build(tmp_path / "x.so")


def test_a_machine_without_ports_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(platform, "machine", lambda: "aarch64")
    with pytest.raises(SettingError, match="which has I/O ports, got linux on aarch64"):
        build_port.check_machine()


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"url": "comedi:/dev/comedi0"}, "url"),
        ({"filter": 7}, "filter: expected from 0 to 6, got 7"),
        ({"rate_hz": 3000}, "rate: expected a divisor of 8000"),
        ({"batch": 65}, "batch: expected from 1 to 64"),
    ],
)
def test_settings_that_cannot_be_are_refused(wrong: dict[str, object], message: str) -> None:
    with pytest.raises(SettingError, match=message):
        Settings(**({"url": "tcp://h:1"} | wrong))  # type: ignore[arg-type]


def test_packets_come_once_a_millisecond_unless_told() -> None:
    assert [Settings("tcp://h:1", rate_hz=rate).samples_a_packet for rate in (8, 1000, 2000, 8000)] == [1, 1, 2, 8]
    assert Settings("tcp://h:1", rate_hz=8000, batch=64).samples_a_packet == 64


@pytest.mark.parametrize("text", ["", "1,2,3", "1,2,3,4,5,x", "0,1,1,1,1,1", "1,1,1,1,1,99999"])
def test_six_numbers_are_asked_for(text: str) -> None:
    with pytest.raises(SettingError, match="--x: expected six whole numbers from 1 to 32767"):
        whole_numbers("--x", text, 1, 32767)
