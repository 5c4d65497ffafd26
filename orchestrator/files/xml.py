"""Parse XML safely, without entities, network or DTD, and check it against schemas."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import fmpy
from lxml import etree

from ..system.errors import DesatError

_SCHEMAS = Path(fmpy.__file__).parent / "ssp" / "schema"


def parse_bytes(data: bytes, place: str) -> Any:
    """Parse XML and return the root element.

    Raises
    ------
    DesatError
        If the XML is bad or has a DOCTYPE; the message begins with file:line.
    """
    parser = etree.XMLParser(
        resolve_entities=False,
        no_network=True,
        load_dtd=False,
        remove_comments=True,
        remove_pis=True,
    )
    try:
        root: Any = etree.fromstring(data, parser)
    except etree.XMLSyntaxError as error:
        raise DesatError(f"{place}:{error.lineno}: {error.msg}") from error
    if root.getroottree().docinfo.doctype:
        raise DesatError(f"{place}: a DOCTYPE is not allowed")
    return root


@cache
def _schema(name: str) -> etree.XMLSchema:
    """Load a schema of SSP."""
    return etree.XMLSchema(etree.parse(str(_SCHEMAS / name)))


def validate(root: Any, schema: str, place: str) -> list[str]:
    """Return the schema errors of a document as `file:line: text`."""
    checker: Any = _schema(schema)
    if checker.validate(root):
        return []
    return [f"{place}:{e.line}: {_plain(e.message)}" for e in checker.error_log]


def _plain(message: str) -> str:
    """Remove the namespaces that make a schema message unreadable."""
    for uri in (
        "SystemStructureDescription",
        "SystemStructureCommon",
        "SystemStructureParameterValues",
        "SystemStructureParameterMapping",
        "SystemStructureSignalDictionary",
    ):
        message = message.replace(f"{{http://ssp-standard.org/SSP1/{uri}}}", "")
    return message
