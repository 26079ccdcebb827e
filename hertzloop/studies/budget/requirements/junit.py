"""The results of requirements as JUnit XML."""

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path

from hertzloop.common.atomic_files import atomic_write
from hertzloop.studies.budget.requirements.check import CheckedRequirement


def junit(path: Path, found: Sequence[CheckedRequirement]) -> None:
    """Write the results as JUnit XML. Raises NotWritten."""
    suite = ET.Element(
        "testsuite",
        name="hertzloop budget",
        tests=str(len(found)),
        failures=str(sum(not one.passed for one in found)),
        errors="0",
        skipped="0",
        time=f"{sum(one.seconds for one in found):z.3f}",
    )
    for one in found:
        case = ET.SubElement(
            suite,
            "testcase",
            classname=f"requirements.{one.row.scene}",
            name=one.row.name,
            time=f"{one.seconds:z.3f}",
        )
        if not one.passed:
            failure = ET.SubElement(case, "failure", message="; ".join(one.fails))
            failure.text = f"{'; '.join(one.fails)}\nReproduce: {one.command}"
        ET.SubElement(case, "system-out").text = "\n".join((*one.holds, *one.warnings))
    root = ET.Element("testsuites")
    root.append(suite)
    ET.indent(root)
    atomic_write(path, ET.tostring(root, encoding="utf-8", xml_declaration=True))
