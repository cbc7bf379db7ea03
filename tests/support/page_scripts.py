"""The scripts of the page of a run in Node.js: no browser, no network, and a Plotly that keeps what it is given."""

from __future__ import annotations

import json
import shutil
import subprocess
from typing import Any

import pytest

from inkloop.report.page.page import SCRIPTS, as_json, own_file

needs_node = pytest.mark.skipif(shutil.which("node") is None, reason="needs Node.js, which `make tools` installs")

DRAWING = """
const given = JSON.parse(require("fs").readFileSync(0, "utf8"));
const stub = () => ({
  clientWidth: 800, children: [], dataset: {}, addEventListener() {},
  append(...more) { this.children.push(...more); }, replaceChildren(...more) { this.children = more; },
  get tHead() { return this.children[1]; }, get tBodies() { return [this.children[2]]; },
  on(_, act) { this.click = (x, y) => act({ points: [{ x, y }] }); },
});
const elements = {};
globalThis.document = { getElementById: (id) => (id === "content" ? null : (elements[id] ??= stub())),
  createElement: stub, body: stub() };
globalThis.window = { addEventListener() {} };
globalThis.Option = class {};
globalThis.setTimeout = () => {};
globalThis.fetch = async () => { throw new Error("nothing is served"); };
globalThis.Plotly = { react: async (place, data, layout) => Object.assign(place, { data, layout }) };
const vm = require("vm");
given.scripts.forEach((text) => vm.runInThisContext(text));
const begun = vm.runInThisContext(`(async (content, more) => {
  await take(content);
  const run = page.runs[0];
  const show = (layer, i, j) => { Object.assign(page, { layer, cell: { i, j } }); return showLayer(); };
  ${given.code}
})`);
begun(given.content, given.more).then((found) => {
  const plain = (_, value) => (ArrayBuffer.isView(value) ? Array.from(value) : value);
  process.stdout.write(JSON.stringify(found, plain));
});
"""


def drawn(content: dict[str, Any], code: str, more: Any = None) -> Any:
    """Take a content in an empty document, run JavaScript, and return what it returns; numbers that are none are None.

    In the code: `run`, the first one, `show(layer, i, j)`, which draws, and `more`.
    """
    given = {"scripts": list(map(own_file, SCRIPTS)), "content": content, "code": code, "more": more}
    words = ["node", "--eval", DRAWING]
    done = subprocess.run(words, input=as_json(given), capture_output=True, encoding="utf-8", check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)
