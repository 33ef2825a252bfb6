"""Work that kills its worker, given to a cluster of this machine; prints what came of each job."""

from __future__ import annotations

import json
import os
import signal
import sys

from trackprofile.fleet.cluster import local
from trackprofile.fleet.scheduling import done


def work(number: int) -> int:
    """Its number; but 3 is deadly and 4 has a bug."""
    if number == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    if number == 4:
        raise ZeroDivisionError("a bug")
    return number


if __name__ == "__main__":
    from deadly import work  # so that the workers find it by its module's name

    with local(2, "auto", retries=1) as client:
        found = dict(done(client, work, {f"job {i}": i for i in range(8)}, retries=1))
    json.dump({name: repr(one) for name, one in sorted(found.items())}, sys.stdout)
