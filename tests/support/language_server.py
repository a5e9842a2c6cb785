"""What a language server answers to an editor."""

import json
import subprocess
from pathlib import Path


class LanguageServer:
    """A server that speaks the protocol of editors by its standard streams, in a folder."""

    def __init__(self, command, folder, settings):
        self.folder, self.settings, self.count = Path(folder), settings, 0
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
        self.process = subprocess.Popen(command, cwd=folder, **pipes)

    def __enter__(self):
        root = self.folder.as_uri()
        folders = [{"uri": root, "name": "user"}]
        formats = {"hover": {"contentFormat": ["plaintext"]}}
        asked = {
            "processId": None,
            "rootUri": root,
            "workspaceFolders": folders,
            "capabilities": {"textDocument": formats},
        }
        self.ask("initialize", asked)
        self.tell("initialized", {})
        return self

    def __exit__(self, *_):
        self.process.terminate()
        self.process.wait()
        for pipe in (self.process.stdin, self.process.stdout):
            pipe.close()

    def open(self, path):
        text = path.read_text(encoding="utf-8")
        document = {"uri": path.as_uri(), "languageId": "python", "version": 1, "text": text}
        self.tell("textDocument/didOpen", {"textDocument": document})

    def at(self, what, path, line, column):
        """What there is at a place, counted from 0: "hover", "signatureHelp", "definition"."""
        place = {"textDocument": {"uri": path.as_uri()}, "position": {"line": line, "character": column}}
        return self.ask(f"textDocument/{what}", place)

    def tell(self, method, params):
        self._send({"method": method, "params": params})

    def ask(self, method, params):
        self.count += 1
        self._send({"id": self.count, "method": method, "params": params})
        while True:
            message = self._read()
            if "method" not in message:
                if message["id"] == self.count:
                    return message["result"]
            elif "id" in message:  # the server asks too
                asked = message["params"].get("items", []) if message.get("params") else []
                found = [self.settings.get(item.get("section")) for item in asked] or None
                self._send({"id": message["id"], "result": found})

    def _send(self, message):
        content = json.dumps({"jsonrpc": "2.0"} | message).encode()
        self.process.stdin.write(b"Content-Length: %d\r\n\r\n%b" % (len(content), content))
        self.process.stdin.flush()

    def _read(self):
        length = 0
        while line := self.process.stdout.readline().strip():
            name, _, value = line.partition(b":")
            length = int(value) if name.lower() == b"content-length" else length
        assert length, "the server has ended"
        return json.loads(self.process.stdout.read(length))
