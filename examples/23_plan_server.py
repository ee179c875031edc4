"""Serve plans to programs in other languages: a capture in by HTTP, JSON out.

It has no password, so it only listens to programs on the same computer.

Run:  python examples/23_plan_server.py [PORT]
Ask:  curl --data-binary @my_capture.npz http://127.0.0.1:8080/
"""

import json
import sys
import tempfile
from contextlib import suppress
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path

from debrisgrasp import Capture, DebrisGraspError, Pipeline
from debrisgrasp.io.plan_json import plan_to_json

LARGEST = 100_000_000  # bytes
PATIENCE = 10.0  # seconds that a client may send nothing, while the others wait


def serve(pipeline: Pipeline, port: int) -> HTTPServer:
    """Return a server that plans on what is sent to it."""

    class Handler(BaseHTTPRequestHandler):
        timeout = PATIENCE

        def do_POST(self) -> None:
            try:
                length = int(self.headers.get("Content-Length", 0))
            except ValueError:
                length = 0
            if not 0 < length <= LARGEST:
                self._reply(413, json.dumps({"error": f"1 to {LARGEST} bytes"}))
                return
            try:
                self._reply(200, self._plan(self.rfile.read(length)))
            except DebrisGraspError as error:
                self._reply(422, json.dumps({"error": str(error)}))

        def _plan(self, content: bytes) -> str:
            with tempfile.TemporaryDirectory() as folder:
                path = Path(folder) / "capture.npz"
                path.write_bytes(content)
                return plan_to_json(pipeline.plan(Capture.load(path)).plan)

        def _reply(self, status: int, text: str) -> None:
            self.send_response(status)
            self.send_header("Content-Type", "application/json")
            with suppress(ConnectionError):  # whoever asked may be gone
                self.end_headers()
                self.wfile.write(text.encode())

        def log_message(self, *_arguments: object) -> None:
            """Say nothing."""

    return HTTPServer(("127.0.0.1", port), Handler)


def main() -> None:
    server = serve(Pipeline(), int(sys.argv[1]) if len(sys.argv) > 1 else 8080)
    print(f"plans at http://127.0.0.1:{server.server_port}/", flush=True)
    server.serve_forever()


if __name__ == "__main__":
    main()
