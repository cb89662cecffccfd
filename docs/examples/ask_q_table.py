"""Ask a running cell's agent for its Q-table, with nothing but Zenoh."""

import json
import sys

import zenoh

endpoint = sys.argv[1] if len(sys.argv) > 1 else "tcp/127.0.0.1:7447"
cell = sys.argv[2] if len(sys.argv) > 2 else "a"
config = zenoh.Config.from_json5(json.dumps({"mode": "client", "connect": {"endpoints": [endpoint]}}))
with zenoh.open(config) as session:
    for reply in session.get(f"treenail/{cell}/agent/q_table?format=json"):
        table = json.loads(reply.ok.payload.to_string())
        for state, best in enumerate(table["best_action"]):
            print(f"state {state}: {table['actions'][best]}, value {table['q'][state][best]:.2f}")
