"""Names and keys as rmw_zenoh makes them of ROS 2's topics, types and nodes. Pure.

    a topic's samples   <domain>/<topic>/<type>/<hash>
    who is there        @ros2_lv/<domain>/<session>/<node>/<number>/NN/<enclave>/<namespace>/<node's name>
                        the same with MP, a publisher, or MS, a subscriber, and .../<topic>/<type>/<hash>/<qos>

In the second kind, a liveliness token, each slash within a part is a percent sign. Source: ros2/rmw_zenoh,
docs/design.md and liveliness_utils.cpp.
"""

from __future__ import annotations

import re
from typing import NamedTuple

import xxhash

from services.ros2.distributions import Distribution
from services.ros2.errors import BadNameError

SPACE = "@ros2_lv"
_TOPIC = re.compile(r"^(?:/[A-Za-z_][A-Za-z0-9_]*)+\Z")
_NODE = re.compile(r"^[A-Za-z_][A-Za-z0-9_]*\Z")
_LONGEST = 200
_USUAL_DEPTH = 42
_NODE_PARTS, _ENDPOINT_PARTS = 9, 13


class Qos(NamedTuple):
    """What a publisher offers or a subscriber asks for; all else is as usual: volatile, the last ``depth`` are kept."""

    reliable: bool = True
    depth: int = 10

    def written(self, distribution: Distribution) -> str:
        """Return it as it stands in a token: what is as rmw_zenoh has it by itself is left out."""
        reliability = "" if self.reliable else "2"
        durability = "2" if distribution.says_durability else ""
        depth = "" if self.depth == _USUAL_DEPTH else str(self.depth)
        return f"{reliability}:{durability}:,{depth}:,:,:,,"


class Endpoint(NamedTuple):
    """A publisher or a subscriber, as its token tells."""

    kind: str
    """MP or MS."""
    node: str
    topic: str
    type_name: str
    """As in ``geometry_msgs/msg/WrenchStamped``."""
    type_hash: str


def checked_topic(topic: str, what: str = "--topic") -> str:
    """Return a topic's full name. Raises BadNameError for what is none."""
    if not _TOPIC.match(topic) or "__" in topic or len(topic) > _LONGEST:
        raise BadNameError(f"{what}: expected the full name of a topic, as /fts_broadcaster/wrench, got {topic[:80]!r}")
    return topic


def checked_node(name: str) -> str:
    """Return a node's name. Raises BadNameError for what is none."""
    if not _NODE.match(name) or len(name) > _LONGEST:
        raise BadNameError(f"node: expected a name of letters, digits and _, got {name[:80]!r}")
    return name


def word(name: str) -> str:
    """Return a cell's name as a part of a topic's: ROS has no dash, and no digit in front."""
    plain = name.replace("-", "_")
    return f"cell_{plain}" if plain[:1].isdigit() else plain


def dds_type(type_name: str) -> str:
    """Return the name of a type as it stands in keys: ``geometry_msgs::msg::dds_::WrenchStamped_``."""
    package, kind, name = type_name.split("/")
    return f"{package}::{kind}::dds_::{name}_"


def ros_type(dds: str) -> str:
    """Return the name of a type as people write it; what is none as it came."""
    parts = dds.split("::")
    if len(parts) == 4 and parts[2] == "dds_" and parts[3].endswith("_"):
        return f"{parts[0]}/{parts[1]}/{parts[3][:-1]}"
    return dds


def topic_key(domain: int, topic: str, type_name: str, type_hash: str) -> str:
    """Return the key of a topic's samples."""
    return f"{domain}{topic}/{dds_type(type_name)}/{type_hash}"


def any_type_key(domain: int, topic: str) -> str:
    """Return the key expression of a topic's samples, whatever their type and hash."""
    return f"{domain}{topic}/*/*"


def type_in(key: str) -> tuple[str, str]:
    """Return type and hash in the key of a sample."""
    *_, dds, type_hash = key.split("/")
    return ros_type(dds), type_hash


def node_token(domain: int, session: str, node: str, number: int = 0) -> str:
    """Return the token of a node in the root namespace; ``session`` is Zenoh's name of the session."""
    return f"{SPACE}/{domain}/{session}/{number}/{number}/NN/%/%/{node}"


def endpoint_token(
    domain: int, session: str, node: str, kind: str, number: int, topic: str, type_name: str, type_hash: str, qos: str
) -> str:
    """Return the token of a publisher (MP) or a subscriber (MS) of node 0, with a number of its own."""
    what = f"{topic.replace('/', '%')}/{dds_type(type_name)}/{type_hash}/{qos}"
    return f"{SPACE}/{domain}/{session}/0/{number}/{kind}/%/%/{node}/{what}"


def gid(token: str) -> bytes:
    """Return the 16 bytes by which samples name their publisher: the hash of its token, XXH3-128, low half first."""
    number = xxhash.xxh3_128_intdigest(token.encode())
    low, high = number & (1 << 64) - 1, number >> 64
    return low.to_bytes(8, "little") + high.to_bytes(8, "little")


def tokens_key(domain: int) -> str:
    """Return the key expression of everybody who is there."""
    return f"{SPACE}/{domain}/**"


def endpoint(token: str) -> Endpoint | None:
    """Return the publisher or subscriber that a token tells of; None for nodes, services, and what is no token."""
    parts = token.split("/")
    if len(parts) < _ENDPOINT_PARTS or parts[0] != SPACE or parts[5] not in ("MP", "MS"):
        return None
    topic, dds, type_hash = (part.replace("%", "/") for part in parts[_NODE_PARTS : _NODE_PARTS + 3])
    return Endpoint(parts[5], parts[8], topic, ros_type(dds), type_hash)
