"""List the services that are alive, in all cells of a router."""

import json
import sys

import zenoh

endpoint = sys.argv[1] if len(sys.argv) > 1 else "tcp/127.0.0.1:7447"
config = zenoh.Config.from_json5(json.dumps({"mode": "client", "connect": {"endpoints": [endpoint]}}))
with zenoh.open(config) as session:
    for reply in session.liveliness().get("treenail/*/alive/*"):
        _, cell, _, service = str(reply.ok.key_expr).split("/")
        print(f"cell {cell}: {service}")
