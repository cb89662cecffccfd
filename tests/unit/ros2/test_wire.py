"""Keys, tokens and attachments to the byte, as rmw_zenoh's documentation shows them; messages there and back."""

from __future__ import annotations

import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("rosbags", reason="the extra ros2 is not installed")
pytest.importorskip("xxhash", reason="the extra ros2 is not installed")

import xxhash

from services.ros2 import attachment, messages, names
from services.ros2.attachment import Attachment
from services.ros2.distributions import DISTRIBUTIONS
from services.ros2.errors import BadNameError, MessageError, PeerError
from services.ros2.messages import Messages, Pose, Wrench
from services.ros2.names import Endpoint, Qos
from services.ros2.node import check_type, nobody, publishers
from services.wire.messages import Force, Torque

JAZZY, OLD = DISTRIBUTIONS["jazzy"], DISTRIBUTIONS["jazzy-0.2.3"]
STRING_HASH = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
SESSION = "8b20917502ee955ac4476e0266340d5c"
NODE = "@ros2_lv/0/aac3178e146ba6f1fc6e6a4085e77f21/0/0/NN/%/%/listener"
TALKER = f"@ros2_lv/0/{SESSION}/0/10/MP/%/%/talker/%chatter/std_msgs::msg::dds_::String_/{STRING_HASH}/::,7:,:,:,,"
"""Both as in docs/design.md of ros2/rmw_zenoh."""
SAMPLE = Attachment(5, 1_764_000_000_123_456_789, bytes(range(16)))
WRENCH = Wrench(1_764_000_000_000_000_001, "tool0", (1.0, -2.5, 3e-3), (0.1, 0.2, -0.3))
NUMBER = st.floats(allow_nan=False, allow_infinity=False)


@pytest.fixture(scope="module")
def jazzy() -> Messages:
    return Messages()


def test_tokens_are_those_of_the_design(jazzy: Messages) -> None:
    assert jazzy.type_hash(messages.STRING) == STRING_HASH
    assert names.node_token(0, "aac3178e146ba6f1fc6e6a4085e77f21", "listener") == NODE
    made = names.endpoint_token(
        0, SESSION, "talker", "MP", 10, "/chatter", messages.STRING, STRING_HASH, Qos(depth=7).written(JAZZY)
    )
    assert made == TALKER
    assert names.endpoint(TALKER) == Endpoint("MP", "talker", "/chatter", messages.STRING, STRING_HASH)
    assert names.endpoint(NODE) is None


def test_what_a_qos_says_is_left_out_where_it_is_as_usual() -> None:
    assert Qos(depth=42).written(JAZZY) == "::,:,:,:,,"
    assert Qos(reliable=False, depth=5).written(JAZZY) == "2::,5:,:,:,,"
    assert Qos(depth=10).written(OLD) == ":2:,10:,:,:,,"


def test_a_topic_key_has_type_and_hash() -> None:
    key = names.topic_key(3, "/robot1/chatter", messages.STRING, STRING_HASH)
    assert key == f"3/robot1/chatter/std_msgs::msg::dds_::String_/{STRING_HASH}"
    assert names.type_in(key) == (messages.STRING, STRING_HASH)


def test_a_publisher_is_named_by_the_hash_of_its_token() -> None:
    number = xxhash.xxh3_128_intdigest(TALKER.encode())
    assert names.gid(TALKER) == struct.pack("<QQ", number & (1 << 64) - 1, number >> 64)


@pytest.mark.parametrize("topic", ["chatter", "/", "/a/", "//a", "/1a", "/a-b", "/a/*", "/a b", "", "/a\n", "/a__b"])
def test_what_is_no_topic_is_refused(topic: str) -> None:
    with pytest.raises(BadNameError, match="--topic: expected the full name of a topic"):
        names.checked_topic(topic)


def test_a_cell_s_name_becomes_a_part_of_a_topic_s() -> None:
    for cell in ("a", "a-b", "1", "cell_2"):
        names.checked_topic(f"/treenail/{names.word(cell)}/wrench")


def test_an_attachment_has_33_bytes_and_77_in_older_versions() -> None:
    plain, named = attachment.written(SAMPLE, JAZZY), attachment.written(SAMPLE, OLD)
    assert (
        plain.hex()
        == (5).to_bytes(8, "little").hex() + SAMPLE.t_ns.to_bytes(8, "little").hex() + "10" + SAMPLE.gid.hex()
    )
    words = [bytes([len(word)]) + word for word in (b"sequence_number", b"source_timestamp", b"source_gid")]
    number, time = plain[:8], plain[8:16]
    assert named == words[0] + number + words[1] + time + words[2] + plain[16:]
    assert (len(plain), len(named)) == (33, 77)
    assert attachment.read(plain, JAZZY) == attachment.read(named, OLD) == SAMPLE


def test_an_attachment_of_another_layout_is_refused_with_what_to_do() -> None:
    with pytest.raises(PeerError, match=r"33 bytes of jazzy, got 77, that of another version .* see --distribution"):
        attachment.read(attachment.written(SAMPLE, OLD), JAZZY)
    with pytest.raises(PeerError, match=r"77 bytes of jazzy-0\.2\.3, got 33"):
        attachment.read(attachment.written(SAMPLE, JAZZY), OLD)
    with pytest.raises(PeerError, match="expected one with every sample, got none"):
        attachment.read(None, JAZZY)
    broken = attachment.written(SAMPLE, OLD).replace(b"source_gid", b"source_GID")
    with pytest.raises(PeerError, match="other names"):
        attachment.read(broken, OLD)
    with pytest.raises(PeerError, match="and 17"):
        attachment.read(SAMPLE.sequence.to_bytes(8, "little") * 2 + b"\x11" + bytes(16), JAZZY)


@given(st.binary(max_size=100))
def test_any_bytes_are_an_attachment_or_are_refused(data: bytes) -> None:
    for distribution in (JAZZY, OLD):
        try:
            assert attachment.read(data, distribution).sequence >= 0
        except PeerError:
            continue


@pytest.mark.parametrize("wrong", [Attachment(0, 1, bytes(16)), Attachment(1, -1, bytes(16)), Attachment(1, 1, b"")])
def test_no_wrong_attachment_is_written(wrong: Attachment) -> None:
    with pytest.raises(PeerError, match="attachment: expected"):
        attachment.written(wrong, JAZZY)


@pytest.mark.parametrize("name", DISTRIBUTIONS)
def test_the_common_types_are_the_same_in_every_distribution(name: str, jazzy: Messages) -> None:
    other = Messages(DISTRIBUTIONS[name])
    for kind in (messages.WRENCH, messages.POSE, messages.INT32, messages.EPISODE):
        assert other.type_hash(kind) == jazzy.type_hash(kind)
    assert other.wrench(WRENCH) == jazzy.wrench(WRENCH)


@given(st.tuples(NUMBER, NUMBER, NUMBER), st.tuples(NUMBER, NUMBER, NUMBER), st.integers(0, 2**31 * 10**9 - 1))
def test_a_wrench_goes_there_and_back(force: Force, torque: Torque, t_ns: int) -> None:
    wrench = Wrench(t_ns, "fts", force, torque)
    assert SHARED.read_wrench(SHARED.wrench(wrench)) == wrench


SHARED = Messages()


def test_a_wrench_to_the_byte(jazzy: Messages) -> None:
    sec, nanosec = divmod(WRENCH.t_ns, 10**9)
    head = b"\x00\x01\x00\x00" + struct.pack("<iI", sec, nanosec) + struct.pack("<I", 6) + b"tool0\x00"
    padded = head + bytes(-(len(head) - 4) % 8)
    assert jazzy.wrench(WRENCH) == padded + struct.pack("<6d", *WRENCH.force_n, *WRENCH.torque_nm)


def test_a_pose_goes_there_and_back(jazzy: Messages) -> None:
    pose = Pose(7, "base", (0.1, 0.2, 0.3), (0.5, -0.5, 0.5, 0.5))
    assert jazzy.read_pose(jazzy.pose(pose)) == pose


@pytest.mark.parametrize("wrong", [math.nan, math.inf, -math.inf])
def test_what_is_no_number_is_refused(jazzy: Messages, wrong: float) -> None:
    with pytest.raises(MessageError, match="finite"):
        jazzy.read_wrench(jazzy.wrench(WRENCH._replace(torque_nm=(0.0, wrong, 0.0))))
    with pytest.raises(MessageError, match="finite"):
        jazzy.read_pose(jazzy.pose(Pose(0, "base", (wrong, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))))
    with pytest.raises(MessageError, match="length 1"):
        jazzy.read_pose(jazzy.pose(Pose(0, "base", (0.0, 0.0, 0.0), (wrong, 0.0, 0.0, 0.0))))


def test_an_orientation_that_is_none_is_refused(jazzy: Messages) -> None:
    with pytest.raises(MessageError, match="length 1"):
        jazzy.read_pose(jazzy.pose(Pose(0, "base", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0))))


@given(st.binary(max_size=200), st.integers(0, 80))
def test_any_bytes_are_a_message_or_are_refused(tail: bytes, kept: int) -> None:
    for data in (tail, SHARED.wrench(WRENCH)[:kept] + tail):
        for reader in (SHARED.read_wrench, SHARED.read_pose):
            try:
                reader(data)
            except MessageError:
                continue


def test_a_message_too_large_to_be_one_is_not_looked_at(jazzy: Messages) -> None:
    with pytest.raises(MessageError, match="at most 4096 bytes"):
        jazzy.read_wrench(jazzy.wrench(WRENCH._replace(frame="x" * 5000)))


def test_a_peer_of_another_type_or_distribution_is_named(jazzy: Messages) -> None:
    ours = jazzy.type_hash(messages.WRENCH)
    check_type(messages.WRENCH, messages.WRENCH, ours, jazzy)
    with pytest.raises(PeerError, match="expected geometry_msgs/msg/WrenchStamped, got geometry_msgs/msg/Wrench;"):
        check_type(messages.WRENCH, "geometry_msgs/msg/Wrench", ours, jazzy)
    with pytest.raises(PeerError, match="as jazzy has it, got 'TypeHashNotSupported': a peer of another distribution"):
        check_type(messages.WRENCH, messages.WRENCH, "TypeHashNotSupported", jazzy)


def test_who_is_missing_and_who_is_there_instead(jazzy: Messages) -> None:
    other = Endpoint("MP", "driver", "/fts/wrench", messages.WRENCH, jazzy.type_hash(messages.WRENCH))
    assert publishers([other], "/fts/wrench") == [other] and publishers([other], "/wrench") == []
    assert nobody([other], "/wrench", messages.WRENCH, 0).endswith("got none: WrenchStamped comes on /fts/wrench")
    assert nobody([], "/wrench", messages.WRENCH, 0).endswith("nobody publishes any WrenchStamped there")
