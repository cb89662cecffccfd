"""Read the newest episode from the journal as it is stored, so that it may be any Zenoh storage that answers."""

import json
import sys

import msgpack
import zenoh

endpoint = sys.argv[1] if len(sys.argv) > 1 else "tcp/127.0.0.1:7447"
cell = sys.argv[2] if len(sys.argv) > 2 else "a"
config = zenoh.Config.from_json5(json.dumps({"mode": "client", "connect": {"endpoints": [endpoint]}}))
with zenoh.open(config) as session:
    for reply in session.get(f"treenail/{cell}/journal/*/latest"):
        assert str(reply.ok.encoding) == "application/msgpack;treenail.JournalEpisode.v4"
        entry = msgpack.unpackb(reply.ok.payload.to_bytes())
        outcome = entry["summary"]["outcome"]
        print(f"run {entry['run']}, episode {entry['episode']}: {len(entry['steps'])} decisions, {outcome}")
