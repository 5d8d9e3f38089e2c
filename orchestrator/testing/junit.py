"""Results as JUnit XML, in the form that continuous integration servers read."""

from __future__ import annotations

import re
from collections.abc import Sequence
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from orchestrator.exit_codes import BAD_INPUT, RUN_FAILED
from orchestrator.testing.suite import FileResult

_UNPRINTABLE = re.compile("[^\t\n\r -\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""What XML 1.0 cannot hold, not even escaped."""

_KINDS = {BAD_INPUT: "bad input", RUN_FAILED: "failed run"}
"""By exit code: why a file came to no verdict. Signals have the other codes."""


def _clean(text: str) -> str:
    return _UNPRINTABLE.sub("?", text)


def _counts(results: Sequence[FileResult]) -> dict[str, str]:
    cases = sum(max(len(result.cases), 1) for result in results)
    return {
        "tests": str(cases),
        "failures": str(sum(len(result.failures) for result in results)),
        "errors": str(sum(bool(result.error) for result in results)),
        "time": f"{sum(result.seconds for result in results):.3f}",
    }


def _add_case(suite: Element, name: str, seconds: float) -> Element:
    facts = {"name": _clean(name), "classname": suite.attrib["name"], "time": f"{seconds:.3f}"}
    return SubElement(suite, "testcase", facts)


def _add_trouble(case: Element, tag: str, kind: str, message: str, text: str) -> None:
    trouble = SubElement(case, tag, {"message": _clean(message), "type": kind})
    trouble.text = _clean(text)


def _add_suite(whole: Element, result: FileResult) -> None:
    skipped = not result.cases and not result.error
    facts = {"name": _clean(result.path.as_posix()), **_counts([result]), "skipped": str(int(skipped))}
    suite = SubElement(whole, "testsuite", facts)
    share = result.seconds / max(len(result.cases), 1)
    where = f"\nlog: {result.log}" if result.log else ""
    if result.error:
        kind = _KINDS.get(result.exit_code, "interrupted")
        first = result.error.partition("\n")[0]
        text = f"{result.error}\n{result.detail}{where}"
        _add_trouble(_add_case(suite, "comes to a verdict", share), "error", kind, first, text)
    elif skipped:
        SubElement(_add_case(suite, "expectations", share), "skipped", {"message": "it states none"})
    for outcome in result.cases:
        case = _add_case(suite, outcome.title, share)
        if not outcome.passed:
            _add_trouble(case, "failure", "expectation", outcome.message, f"{outcome.message}{where}")


def junit_xml(results: Sequence[FileResult]) -> bytes:
    """Return the XML document: a suite a file, a test case an expectation.

    The time of a run is shared evenly by its expectations, so that sums are right. A file that came to no
    verdict is one case with an error, a file without expectations one that was skipped.
    """
    whole = Element("testsuites", {"name": "gauntlet", **_counts(results)})
    for result in results:
        _add_suite(whole, result)
    indent(whole)
    return bytes(tostring(whole, encoding="utf-8", xml_declaration=True)) + b"\n"
