"""The scripts of the page of a run in Node.js: no browser, no network, and a Plotly that keeps what it is given."""

from __future__ import annotations

import json
import shutil
import subprocess
from typing import Any

import pytest

from inkloop.report.page.page import SCRIPTS, own_file

needs_node = pytest.mark.skipif(shutil.which("node") is None, reason="needs Node.js, which `make tools` installs")

DRAWING = """
const given = JSON.parse(require("fs").readFileSync(0, "utf8"));
const element = () => ({
  clientWidth: 800, closest: () => null, addEventListener() {}, removeAllListeners() {},
  on(_, act) { this.click = act; },
});
const elements = {};
globalThis.document = { getElementById: (id) => (id === "content" ? null : (elements[id] ??= element())) };
globalThis.window = { addEventListener() {} };
globalThis.EventSource = class {};
globalThis.Plotly = { react: async (place, data) => { place.data = data; } };
const vm = require("vm");
given.scripts.forEach((text) => vm.runInThisContext(text));
const begun = vm.runInThisContext(`(async (given) => {
  const run = new Run(given);
  await run.add(given);
  ${given.code}
})`);
begun(given.run).then((found) => {
  const plain = (_, value) => (ArrayBuffer.isView(value) ? Array.from(value) : value);
  process.stdout.write(JSON.stringify(found, plain));
});
"""


def drawn(description: dict[str, Any], code: str) -> Any:
    """Run JavaScript after the scripts of the page, in an empty document, and return what it returns.

    description: a run of a content, `given` in the code, of which `run` was made. Numbers that are none come as None.
    """
    words = ["node", "--eval", DRAWING]
    given = json.dumps({"scripts": list(map(own_file, SCRIPTS)), "run": description, "code": code})
    done = subprocess.run(words, input=given, capture_output=True, encoding="utf-8", check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)
