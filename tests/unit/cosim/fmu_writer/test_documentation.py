"""The page in an FMU has the readme of its model and every variable."""

from __future__ import annotations

from dataclasses import replace

from inkloop.fmu_writer import documentation
from inkloop.fmu_writer.archive import read_definition
from inkloop.fmu_writer.export import find_fmu

README = """# Sensor

Reads `height` where a < b.

## Limits

- one
- two,
  over two lines

    first = 1
      second = 2
"""
BODY = """<h1>Sensor</h1>
<p>Reads <code>height</code> where a &lt; b.</p>
<h2>Limits</h2>
<ul><li>one</li><li>two,
  over two lines</li></ul>
<pre>first = 1
  second = 2</pre>
<h2>Variables</h2>"""
MODEL = read_definition(find_fmu("ProfileSensor"))


def rows(page: str) -> dict[str, list[str]]:
    cells = [row.split("</td><td>") for row in page.split("<tr><td>")[1:]]
    return {name: [*rest, last.partition("</td>")[0]] for name, *rest, last in cells}


def test_markdown_of_a_readme_becomes_html() -> None:
    page = documentation.index_html(MODEL, README).decode()
    assert page.partition("<body>\n")[2].startswith(BODY)
    assert "<title>ProfileSensor</title>" in page


def test_table_states_type_unit_start_and_limits_of_each_variable() -> None:
    found = rows(documentation.index_html(MODEL, "").decode())
    assert list(found) == [variable.name for variable in MODEL.exposed]
    assert found["measured_height"][:4] == ["output", "real (nx, ny)", "m", ""]
    causality, type_, unit, start, about = found["noise_std"]
    assert (causality, type_, unit, float(start)) == ("parameter", "real", "m", 0.0)
    assert about.endswith("(at least 0.0)")


def test_section_comes_before_the_table_which_is_written_again() -> None:
    page = documentation.index_html(MODEL, README)
    shorter = replace(MODEL, variables=MODEL.variables[:-1])
    found = documentation.with_section(page, "<h2>Own</h2>", shorter).decode()
    assert BODY.replace("<h2>Variables</h2>", "<h2>Own</h2>\n<h2>Variables</h2>") in found
    assert list(rows(found)) == [variable.name for variable in shorter.exposed]
    assert found.endswith("</table>\n</body>\n</html>\n")
