"""A server of the web for tests, with what may go wrong with one."""

import hashlib
import re
from datetime import UTC, datetime

from werkzeug import Request, Response


class Server:
    """A folder that is served, with what is wrong with it."""

    def __init__(self, folder, httpserver):
        self.folder, self.asked = folder, []
        self.busy = 0  # answers that are 503
        self.cut = ""  # end of names of files that arrive cut off
        self.tells = ""  # of "tag", "weak" and "time", what it tells of files besides their size
        httpserver.expect_request(re.compile(".*")).respond_with_handler(self.answer)
        self.url = httpserver.url_for("/")

    def answer(self, request: Request) -> Response:
        """Answer with a file, or a part of it."""
        self.asked.append(request.path)
        if self.busy:
            self.busy -= 1
            return Response("later", status=503)
        file = self.folder / request.path.lstrip("/")
        if not file.is_file():
            return Response("none", status=404)
        data = file.read_bytes()
        if self.cut and request.path.endswith(self.cut):
            data = data[: len(data) // 2]
        whole = Response(data, headers={"Accept-Ranges": "bytes"})
        if "tag" in self.tells or "weak" in self.tells:
            whole.set_etag(hashlib.sha256(data).hexdigest(), weak="weak" in self.tells)
        if "time" in self.tells:
            whole.last_modified = datetime.fromtimestamp(file.stat().st_mtime, UTC)
        return whole.make_conditional(request, accept_ranges=True, complete_length=len(data))
