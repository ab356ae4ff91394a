// A click on a header sorts its table, another turns the order. Without this script the tables stand
// as they are. Cells are compared by data-value, a size in SI, else by their text; those without a
// number stay last.
const collator = new Intl.Collator("en", { numeric: true });
const paged = new Map();
for (const table of document.querySelectorAll("table.sortable")) {
  const body = table.tBodies[0];
  if (body.rows.length < 2) continue;
  const heads = [...table.tHead.rows[0].cells];
  heads.forEach((head, column) => {
    if (head.hasAttribute("data-unsorted")) return;
    const button = document.createElement("button");
    button.type = "button";
    button.append(...head.childNodes);
    head.append(button);
    const numeric = [...body.rows].some((row) => "value" in row.cells[column].dataset);
    const key = (row) => {
      const cell = row.cells[column];
      return numeric ? parseFloat(cell.dataset.value) : cell.textContent.trim();
    };
    const compare = (a, b) => (numeric ? a - b : collator.compare(a, b));
    button.addEventListener("click", () => {
      const turned = head.getAttribute("aria-sort") === "ascending" ? -1 : 1;
      for (const each of heads) each.removeAttribute("aria-sort");
      head.setAttribute("aria-sort", turned > 0 ? "ascending" : "descending");
      const rows = [...body.rows].map((row) => [key(row), row]);
      const last = ([value]) => Number.isNaN(value);
      rows.sort((a, b) => last(a) - last(b) || (last(a) ? 0 : turned * compare(a[0], b[0])));
      body.append(...rows.map(([, row]) => row));
      paged.get(table)?.();
    });
  });
}

// Of a long table the first rows are shown that are searched for, and a button brings more: to lay
// out thousands takes seconds.
const PAGE = 50;
for (const table of document.querySelectorAll("table.sortable")) {
  const body = table.tBodies[0], more = document.createElement("button");
  if (body.rows.length <= PAGE && !table.matches(".comparison")) continue;
  let most = PAGE, wanted = () => true;
  const show = (...filter) => {
    if (filter.length) [most, wanted] = [PAGE, ...filter];
    const rows = [...body.rows], found = rows.filter(wanted), shown = new Set(found.slice(0, most));
    for (const row of rows) row.hidden = !shown.has(row);
    more.hidden = found.length <= most;
    more.textContent = `${shown.size} of ${found.length} rows; show more`;
  };
  more.type = "button";
  more.addEventListener("click", () => {
    most += PAGE;
    show();
  });
  addEventListener("beforeprint", () => {
    most = Infinity;
    show();
  });
  table.closest(".scroll").after(more);
  paged.set(table, show);
  show();
}

// A link, or the address of the page, opens the sections around its target. Newer browsers do this
// without a script.
const targetOf = (link) => document.getElementById(decodeURIComponent(link.hash.slice(1)));
const reveal = (target) => {
  const sections = [...document.querySelectorAll("details:not([open])")].filter((s) => s.contains(target));
  for (const each of sections) each.open = true;
  return sections.length;
};
const revealAddress = () => {
  const target = document.querySelector(":target");
  if (reveal(target)) target.scrollIntoView();
};
addEventListener("click", ({ target }) => {
  const link = target.closest("a[href^='#']");
  if (link) reveal(targetOf(link));
});
addEventListener("hashchange", revealAddress);
revealAddress();

// A button below each picture shows it at the full width of the page, and again as it was.
for (const figure of document.querySelectorAll(".figures figure")) {
  const button = document.createElement("button");
  Object.assign(button, { type: "button", className: "enlarge", ariaLabel: "Enlarge" });
  button.setAttribute("aria-pressed", "false");
  button.addEventListener("click", () => {
    const large = figure.classList.toggle("large");
    button.setAttribute("aria-pressed", large);
  });
  figure.querySelector("figcaption").append(button);
}

// The contents show where the reader is: the last section that has reached the top.
const links = [...document.querySelectorAll("nav a[href^='#']")];
const places = links.map(targetOf).map((part) => part?.closest("details") ?? part);
const reached = parseFloat(getComputedStyle(document.documentElement).scrollPaddingTop) + 20;
const follow = () => {
  let now = -1;
  places.forEach((part, i) => {
    if (part && part.getBoundingClientRect().top < reached) now = i;
  });
  links.forEach((a, i) => (i === now ? a.setAttribute("aria-current", "true") : a.removeAttribute("aria-current")));
};
addEventListener("scroll", follow, { passive: true });
follow();

// Of many devices those are shown whose row holds the text that is searched for.
const compared = [...document.querySelectorAll("table.comparison")];
if (compared.length && compared[0].tBodies[0].rows.length > 10) {
  const search = document.createElement("input");
  Object.assign(search, { type: "search", placeholder: "Search devices and verdicts" });
  search.setAttribute("aria-label", search.placeholder);
  compared[0].closest(".scroll").before(search);
  // read at the first letter
  let texts = null;
  const read = () => {
    texts = new Map();
    for (const row of compared.slice(0, 2).flatMap((t) => [...t.tBodies[0].rows])) {
      const label = row.cells[0].textContent;
      texts.set(label, `${texts.get(label) ?? ""}\n${row.textContent.toLowerCase()}`);
    }
  };
  search.addEventListener("input", () => {
    if (!texts) read();
    const text = search.value.trim().toLowerCase();
    for (const table of compared) paged.get(table)((row) => texts.get(row.cells[0].textContent).includes(text));
  });
}
