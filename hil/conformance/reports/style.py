"""How the page looks: by daylight, in the dark and on paper. Colours are pairs that everyone can read."""

from __future__ import annotations

__all__ = ["DARK", "LIGHT", "STYLE"]

LIGHT = {
    "text": "#1d2127",
    "quiet": "#57606a",
    "ground": "#ffffff",
    "raised": "#f5f6f8",
    "line": "#d5d9df",
    "link": "#0b57b0",
    "fail": "#9b1219",
    "fail-ground": "#fde7e8",
    "warn": "#7a4600",
    "warn-ground": "#fff1d4",
    "known": "#6d2b8a",
    "known-ground": "#f5e8fa",
    "open": "#2c4a86",
    "open-ground": "#e6edfa",
    "none": "#57606a",
    "none-ground": "#eceef1",
    "pass": "#17602f",
    "pass-ground": "#e3f4e8",
}
DARK = {
    "text": "#e6e8eb",
    "quiet": "#a3abb5",
    "ground": "#15181c",
    "raised": "#1e2227",
    "line": "#383e46",
    "link": "#85b8ff",
    "fail": "#ffb0b3",
    "fail-ground": "#4a1518",
    "warn": "#ffd48a",
    "warn-ground": "#422c05",
    "known": "#e2b5f5",
    "known-ground": "#3b1b48",
    "open": "#b3ccff",
    "open-ground": "#1d2f55",
    "none": "#b4bbc4",
    "none-ground": "#2a2f36",
    "pass": "#9be0b0",
    "pass-ground": "#12391f",
}
KINDS = {
    "fail": "fail",
    "unexpected_pass": "fail",
    "warn": "warn",
    "known_failure": "known",
    "inconclusive": "open",
    "open": "open",
    "not_applicable": "none",
    "pass": "pass",
}
"""The pair of colours of a standing, or of the run's verdict."""


def _variables(colours: dict[str, str]) -> str:
    return " ".join(f"--{name}: {colour};" for name, colour in colours.items())


def _kinds() -> str:
    return "\n".join(
        f"b.{kind}, .verdict.{kind} {{ color: var(--{pair}); background: var(--{pair}-ground); }}"
        for kind, pair in KINDS.items()
    )


STYLE = f"""
:root {{ color-scheme: light; {_variables(LIGHT)} }}
@media screen and (prefers-color-scheme: dark) {{ :root {{ color-scheme: dark; {_variables(DARK)} }} }}
* {{ box-sizing: border-box; }}
body {{
  margin: 0 auto; max-width: 76rem; padding: 2rem 1.25rem 6rem;
  font: 1rem/1.5 system-ui, sans-serif; color: var(--text); background: var(--ground);
}}
h1 {{ margin: 0 0 1rem; font-size: 1.9rem; line-height: 1.2; overflow-wrap: anywhere; }}
h2 {{ margin: 3rem 0 1rem; padding-bottom: .3rem; font-size: 1.3rem; border-bottom: 1px solid var(--line); }}
h3 {{ margin: 2rem 0 .5rem; font-size: 1.05rem; }}
a {{ color: var(--link); text-underline-offset: .15em; }}
p {{ margin: .35rem 0; max-width: 70ch; }}
:focus-visible {{ outline: 2px solid var(--link); outline-offset: 2px; }}
:target {{ outline: 2px solid var(--link); outline-offset: 2px; }}
.kicker {{ margin: 0; color: var(--quiet); }}
.verdict {{
  max-width: none; margin: 0; padding: .8rem 1rem; border-radius: .4rem; font-size: 1.15rem; font-weight: 600;
}}
.small {{ font-size: .875rem; color: var(--quiet); }}
.reason {{ font-weight: 600; white-space: pre-wrap; overflow-wrap: anywhere; }}
li, td {{ overflow-wrap: anywhere; }}
b[class] {{
  display: inline-block; padding: 0 .5em; border-radius: .3rem; font-size: .875rem; font-weight: 600;
  white-space: nowrap;
}}
search {{
  position: sticky; top: 0; z-index: 1; display: flex; flex-wrap: wrap; gap: .5rem 1.25rem; align-items: center;
  margin-top: 1rem; padding: .6rem 0; background: var(--ground); border-bottom: 1px solid var(--line);
}}
search input, search select {{
  font: inherit; padding: .2rem .5rem; color: var(--text); background: var(--raised); border: 1px solid var(--line);
  border-radius: .3rem; max-width: 100%;
}}
[hidden] {{ display: none !important; }}
[id] {{ scroll-margin-top: 4rem; }}
.cases {{ margin: .9rem 0; }}
.cases ul {{ margin: 0; padding: 0; list-style: none; }}
.cases p {{ max-width: none; }}
{_kinds()}
nav ul {{ display: flex; flex-wrap: wrap; gap: .25rem 1.25rem; margin: 1rem 0 0; padding: 0; list-style: none; }}
.findings {{ margin: 0; padding: 0; list-style: none; }}
.findings > li {{ margin: 0 0 1rem; }}
.scrolling {{ overflow-x: auto; }}
table {{ border-collapse: collapse; width: 100%; }}
th, td {{ padding: .4rem .6rem; text-align: left; vertical-align: top; border-bottom: 1px solid var(--line); }}
thead th {{ font-size: .875rem; color: var(--quiet); }}
td ul {{ margin: 0; padding: 0; list-style: none; }}
.counts {{ width: auto; font-variant-numeric: tabular-nums; }}
.counts td {{ text-align: right; }}
.counts tfoot th, .counts tfoot td {{ font-weight: 700; border-bottom: 0; }}
.counts .none {{ color: var(--none); }}
.counts .some {{ font-weight: 600; }}
.clauses {{ table-layout: fixed; min-width: 46rem; }}
.clauses th:first-child {{ width: 7rem; }}
.clauses th:last-child {{ width: 9.5rem; }}
.clauses tbody:last-child tr:last-child > * {{ border-bottom: 0; }}
details {{ margin: .35rem 0; padding: .45rem .8rem; background: var(--raised); border-radius: .4rem; }}
details > :not(summary) {{ margin-top: .5rem; }}
summary {{ cursor: pointer; }}
dl {{ margin: 0; }}
dl > div {{ display: grid; grid-template-columns: minmax(7rem, 11rem) 1fr; gap: 1rem; padding: .2rem 0; }}
dt {{ color: var(--quiet); overflow-wrap: anywhere; }}
dd {{ margin: 0; white-space: pre-wrap; overflow-wrap: anywhere; }}
.evidence dd {{ font: .875rem/1.45 ui-monospace, monospace; }}
.findings > li > .evidence {{ padding: .2rem .8rem; border-left: .25rem solid var(--quiet); }}
.bytes {{ max-height: 4.4em; overflow: auto; color: var(--quiet); }}
@media print {{
  :root {{ font-size: 9pt; }}
  body {{ max-width: none; padding: 0; }}
  .clauses {{ min-width: 0; }}
  nav, search {{ display: none; }}
  h2, h3, summary {{ break-after: avoid; }}
  tr, .findings > li, summary, dl > div {{ break-inside: avoid; }}
  thead {{ display: table-header-group; }}
  #clauses, #cases {{ break-before: page; }}
  details {{ padding: .2rem 0; background: none; }}
  b[class], .verdict {{ border: 1px solid; }}
  a {{ color: inherit; text-decoration: none; }}
  .scrolling, .bytes {{ max-height: none; overflow: visible; }}
}}
"""
