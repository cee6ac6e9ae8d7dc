"""The script of the page: it searches and filters findings, clauses and cases."""

from __future__ import annotations

__all__ = ["SCRIPT"]

SCRIPT = """
const search = document.querySelector("search"), [words, kind, told] = search.querySelectorAll("input, select, output");
const items = [...document.querySelectorAll("[data-kind]")].map(item => ({
  item,
  text: `${item.closest(".cases")?.firstChild.textContent ?? ""} ${item.textContent}`.toLowerCase(),
}));
const parents = [...document.querySelectorAll("section, .cases, #clauses details")]
  .map(parent => [parent, [...parent.querySelectorAll("[data-kind]")]])
  .filter(([, inside]) => inside.length);
const about = document.querySelectorAll("#provenance, #counts");
const cases = [...document.querySelectorAll("#cases [data-kind]")];

function filter() {
  const wanted = words.value.toLowerCase().split(/\\s+/).filter(Boolean);
  const searching = Boolean(wanted.length || kind.value);
  for (const { item, text } of items)
    item.hidden = Boolean(kind.value && item.dataset.kind != kind.value) || !wanted.every(word => text.includes(word));
  for (const [parent, inside] of parents) {
    parent.hidden = inside.every(item => item.hidden);
    if (parent.tagName == "DETAILS") parent.open = searching && !parent.hidden;
  }
  for (const part of about) part.hidden = searching;
  told.value = searching ? `${cases.filter(item => !item.hidden).length} of ${cases.length} cases` : "";
}

search.hidden = false;
search.addEventListener("input", filter);
"""
