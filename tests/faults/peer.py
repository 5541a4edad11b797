"""A zenoh router, or a subscriber that writes the key of each sample on a line: processes that tests stop and kill.

`python -m tests.faults.peer router|subscriber ENDPOINT`; it ends once nobody holds its standard input any more.
"""

import sys

import zenoh

from service.simulator.operator import zenoh_session


def main(kind: str, endpoint: str) -> None:
    def tell(sample: zenoh.Sample) -> None:
        print(sample.key_expr, flush=True)

    if kind == "router":
        session = zenoh_session(mode="router", listen=[endpoint])
        print("open", flush=True)
    else:
        session = zenoh_session(connect=[endpoint])
        session.declare_subscriber("distloc/**", tell)
    with session:
        sys.stdin.read()


if __name__ == "__main__":
    main(*sys.argv[1:])
