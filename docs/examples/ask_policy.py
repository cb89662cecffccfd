"""Ask a running cell's agent what it would do in a state, or when it feels a force, with nothing but Zenoh."""

import json
import sys

import zenoh

endpoint = sys.argv[1] if len(sys.argv) > 1 else "tcp/127.0.0.1:7447"
question = sys.argv[2] if len(sys.argv) > 2 else "ft=-0.3,0.34,-0.74,-0.037,-0.033,0"
cell = sys.argv[3] if len(sys.argv) > 3 else "a"
config = zenoh.Config.from_json5(json.dumps({"mode": "client", "connect": {"endpoints": [endpoint]}}))
with zenoh.open(config) as session:
    replies = list(session.get(f"treenail/{cell}/agent/policy?{question};format=json", timeout=2.0))
    if not replies:
        sys.exit("nobody answered: is the cell up, and its agent alive?")
    if replies[0].ok is None:
        sys.exit(replies[0].err.payload.to_string())
    answer = json.loads(replies[0].ok.payload.to_string())
    print(f"contact state {answer['state']}, match {answer['match']}")
    for action, probability in zip(answer["actions"], answer["probabilities"], strict=True):
        print(f"{action}: {100 * probability:.1f} %")
