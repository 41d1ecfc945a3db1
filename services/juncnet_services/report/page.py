"""The report as one HTML file, with its pictures in it."""

import base64
import html
import json
import time
from collections.abc import Sequence
from pathlib import Path

from juncnet.recording.reader import Recording
from juncnet_services.report.flight_data import FlightData
from juncnet_services.report.flight_map import turn_words
from juncnet_services.report.verdict import Verdict

STYLE = """
:root{color-scheme:light dark;--ink:#1b1b1b;--paper:#fff;--soft:#f3f4f6;--line:#d5d7da}
@media(prefers-color-scheme:dark){:root{--ink:#eaeaea;--paper:#16181b;--soft:#22262b;--line:#3a3f45}}
*{box-sizing:border-box}
body{font:16px/1.5 system-ui,sans-serif;margin:0 auto;max-width:1100px;padding:24px 16px;
 color:var(--ink);background:var(--paper)}
h1{font-size:1.6rem;margin:0}h2{font-size:1.15rem;margin:2rem 0 .5rem}
.figures{display:grid;grid-template-columns:repeat(auto-fit,minmax(150px,1fr));gap:8px;
 margin:16px 0}
.figures div{background:var(--soft);border-radius:8px;padding:10px 12px}
.figures b{display:block;font-size:1.5rem}
img{max-width:100%;border-radius:6px;background:#fff}
.strip{display:grid;grid-template-columns:repeat(auto-fill,minmax(min(320px,100%),1fr));gap:14px}
.strip figure{margin:0}.strip .pair{display:grid;grid-template-columns:16fr 9fr;gap:4px}
.strip .pair img{width:100%}
.wide{overflow-x:auto}table{border-collapse:collapse;width:100%}
td,th{border-bottom:1px solid var(--line);
 padding:4px 8px;text-align:left;vertical-align:top}
pre{background:var(--soft);padding:12px;overflow:auto;border-radius:6px;font-size:13px}
.right{color:#2e7d32}.wrong{color:#c62828}
"""


def page(
    recording: Recording,
    data: FlightData,
    verdict: Verdict,
    plots: dict[str, Path],
    strip: Sequence[tuple[str, Path, Path]],
) -> str:
    """Return the page; `strip` has title, picture and reconstruction of every junction."""
    about = recording.metadata
    model = "unknown" if data.model is None else data.model.model.name
    parts = [
        f"<h1>Flight {_text(recording.flight)}</h1>",
        f"<p>Robot {_text(recording.robot)}, model {_text(model)}, "
        f"JuncNet {_text(about['version'])}. {_text(verdict.sentence)}</p>",
        _figures(data, verdict),
        _section("Path", plots.get("path")),
        _section("Junction probability", plots.get("probability")),
        _strip(strip),
        _section("Turns, on the map of the road's surface", plots.get("turns")),
        _section("Latency and rates", plots.get("latency")),
        _events(data),
        _incidents(data),
        _configuration(recording, data),
    ]
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width,initial-scale=1">'
        f"<title>Flight {_text(recording.flight)}</title><style>{STYLE}</style></head>"
        f"<body>{''.join(parts)}</body></html>"
    )


def _text(value: object) -> str:
    return html.escape(str(value))


def _image(file: Path, alt: str) -> str:
    kind = "jpeg" if file.suffix == ".jpg" else "png"
    data = base64.b64encode(file.read_bytes()).decode()
    return f'<img alt="{_text(alt)}" src="data:image/{kind};base64,{data}">'


def _section(title: str, file: Path | None) -> str:
    return "" if file is None else f"<h2>{title}</h2>{_image(file, title)}"


def _figures(data: FlightData, verdict: Verdict) -> str:
    rows = [
        ("junctions counted", f"{data.counted}"),
        ("turns taken", f"{len(data.turns)}"),
        ("duration", f"{data.duration_s:.0f} s"),
        ("restarts", f"{sum(data.restarts.values())}"),
        *verdict.figures,
    ]
    cells = "".join(f"<div><b>{_text(value)}</b>{_text(name)}</div>" for name, value in rows)
    return f'<div class="figures">{cells}</div>'


def _strip(strip: Sequence[tuple[str, Path, Path]]) -> str:
    if not strip:
        return ""
    figures = "".join(
        f'<figure><div class="pair">{_image(picture, title)}'
        f"{_image(radon, title + ', Radon reconstruction')}</div>"
        f"<figcaption>{_text(title)}</figcaption></figure>"
        for title, picture, radon in strip
    )
    return f'<h2>Junctions, as the network saw them</h2><div class="strip">{figures}</div>'


def _table(head: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    top = "".join(f"<th>{_text(name)}</th>" for name in head)
    body = "".join(
        "<tr>" + "".join(f"<td>{_text(cell)}</td>" for cell in row) + "</tr>" for row in rows
    )
    return f'<div class="wide"><table><tr>{top}</tr>{body}</table></div>'


def _events(data: FlightData) -> str:
    rows = [
        (
            f"{m.time_s:.1f} s",
            m.event.kind,
            m.event.count,
            m.event.label,
            turn_words(m.event.turn),
            f"{m.event.probability:.2f}",
        )
        for m in data.events
    ]
    head = ("time", "event", "junction", "class", "turn", "probability")
    return f"<h2>Events</h2>{_table(head, rows)}"


def _incidents(data: FlightData) -> str:
    rows = [(f"{i.time_s:.1f} s", i.process, i.text) for i in data.incidents]
    table = _table(("time", "process", "what"), rows) if rows else "<p>None.</p>"
    return f"<h2>Health incidents</h2>{table}"


def _configuration(recording: Recording, data: FlightData) -> str:
    mission = {} if data.navigation is None else data.navigation.mission.model_dump(mode="json")
    model = {} if data.model is None else data.model.model_dump(mode="json")
    made = time.strftime("%Y-%m-%d %H:%M:%S")
    blocks = (
        ("Mission", json.dumps(mission, indent=2)),
        ("Model", json.dumps(model, indent=2)),
        ("Recording", json.dumps({**recording.metadata, "report made": made}, indent=2)),
        ("Layout", recording.layout or "unknown"),
    )
    shown = "".join(
        f"<details><summary>{name}</summary><pre>{_text(text)}</pre></details>"
        for name, text in blocks
    )
    return f"<h2>Configuration</h2>{shown}"
