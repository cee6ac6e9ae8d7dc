// The keyboard reaches what scrolls sideways: diagrams, listings and wide tables.
function reach() {
  document.querySelectorAll("pre, .table-wrapper, .cell_output").forEach((part) => {
    if (part.scrollWidth > part.clientWidth) part.tabIndex = 0;
    else part.removeAttribute("tabindex");
  });
}

addEventListener("load", reach);
addEventListener("resize", reach);
