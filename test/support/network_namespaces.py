# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Several hosts on this machine: network namespaces, each with an interface on a switch of their own.

Needs the program `ip` (package iproute2) and the right to make namespaces, which root has outside of most containers.
Nothing of the network of this machine is changed.
"""

from __future__ import annotations

import itertools
import os
import shutil
import signal
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from threading import Thread

INTERFACE = "eth0"
"""Name of the interface of each host."""
MULTICAST, STATIC_PEERS, DISCOVERY_SERVER = WAYS = ("multicast", "static peers", "discovery server")
"""How processes on several hosts find each other."""
SERVER = "fast-discovery-server"
"""Program of Fast DDS."""
SERVER_PORT = 11811
END_TIMEOUT = 60.0
"""Time for a process to end [s]."""
_numbers = itertools.count(1)


@dataclass(frozen=True)
class Host:
    """One network namespace."""

    namespace: str
    address: str
    """Address in the network of all hosts."""

    def command(self, words: Sequence[str]) -> list[str]:
        """Return the words that run a command on this host."""
        return ["ip", "netns", "exec", self.namespace, *words]

    @contextmanager
    def running(self, words: Sequence[str], **environment: str) -> Iterator[subprocess.Popen[str]]:
        """Run a process on this host, with these variables besides those of this process.

        The block begins with the first line of its output, and the process is interrupted at the end.
        """
        pipe = subprocess.PIPE
        process = subprocess.Popen(
            self.command(words), env={**os.environ, **environment}, stdout=pipe, stderr=subprocess.DEVNULL, text=True
        )
        try:
            assert process.stdout is not None and process.stdout.readline(), f"{words[0]} ended at once"
            drain = Thread(target=process.stdout.read, daemon=True)
            drain.start()
            yield process
        finally:
            process.send_signal(signal.SIGINT)
            try:
                process.wait(END_TIMEOUT)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
            drain.join()
            process.stdout.close()

    def run(self, words: Sequence[str], timeout: float, **environment: str) -> subprocess.CompletedProcess[str]:
        """Run a process on this host until it ends."""
        return subprocess.run(
            self.command(words),
            env={**os.environ, **environment},
            capture_output=True,
            text=True,
            timeout=timeout,
            check=False,
        )


def why_not() -> str:
    """Return why there can be no namespaces here, in one line; '' if there can."""
    if shutil.which("ip") is None:
        return "needs the program ip: apt-get install iproute2"
    name = f"posfet{os.getpid()}try"
    tried = _ip("netns", "add", name)
    if tried.returncode:
        return f"may not make network namespaces: {' '.join(tried.stderr.split())}"
    linked = _ip("-n", name, "link", "add", "br0", "type", "bridge")
    _ip("netns", "del", name)
    return f"cannot make a bridge: {' '.join(linked.stderr.split())}" if linked.returncode else ""


@contextmanager
def hosts(count: int, multicast: bool = True) -> Iterator[list[Host]]:
    """Make hosts that reach each other, and remove them afterwards.

    Parameters
    ----------
    count : int
        Number of hosts, at most 250.
    multicast : bool, optional
        Whether the interfaces carry multicast; many wireless networks do not.
    """
    prefix = f"posfet{os.getpid()}n{next(_numbers)}"
    switch = f"{prefix}switch"
    with ExitStack() as stack:
        _add(stack, switch)
        _do("-n", switch, "link", "add", "br0", "type", "bridge")
        _do("-n", switch, "link", "set", "br0", "up")
        made = []
        for number in range(1, count + 1):
            host = Host(f"{prefix}h{number}", f"10.77.0.{number}")
            _add(stack, host.namespace)
            port = f"port{number}"
            _do("-n", switch, "link", "add", port, "type", "veth", "peer", "name", INTERFACE, "netns", host.namespace)
            _do("-n", switch, "link", "set", port, "master", "br0", "up")
            inside = ("-n", host.namespace)
            _do(*inside, "addr", "add", f"{host.address}/24", "dev", INTERFACE)
            _do(*inside, "link", "set", "lo", "up")
            _do(*inside, "link", "set", INTERFACE, "multicast", "on" if multicast else "off", "up")
            made.append(host)
        yield made


@contextmanager
def discovery(way: str, made: Sequence[Host]) -> Iterator[tuple[dict[str, str], dict[str, str]]]:
    """Let processes on hosts find each other in one of `WAYS`; a discovery server runs on the first host meanwhile.

    Parameters
    ----------
    way : str
        One of `WAYS`.
    made : sequence of Host
        All hosts.

    Yields
    ------
    tuple of dict
        Environment variables of a stack, and of tools that look at the whole graph.
    """
    common = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET", "PYTHONUNBUFFERED": "1"}
    if way == STATIC_PEERS:
        common["ROS_STATIC_PEERS"] = ";".join(host.address for host in made)
    if way != DISCOVERY_SERVER:
        yield common, common
        return
    words = [SERVER, "-i", "0", "-l", made[0].address, "-p", str(SERVER_PORT)]
    with made[0].running(words):
        common["ROS_DISCOVERY_SERVER"] = f"{made[0].address}:{SERVER_PORT}"
        yield common, {**common, "ROS_SUPER_CLIENT": "TRUE"}


def _add(stack: ExitStack, name: str) -> None:
    _do("netns", "add", name)
    stack.callback(_ip, "netns", "del", name)


def _ip(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(["ip", *words], capture_output=True, text=True, check=False)


def _do(*words: str) -> None:
    done = _ip(*words)
    if done.returncode:
        raise OSError(f"ip {' '.join(words)}: {done.stderr.strip()}")
