// A click on a header sorts its table, another turns the order. Without this script the tables stand
// as they are. Cells are compared by data-value, a size in SI, else by their text; those without a
// number stay last.
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
    const compare = (a, b) => (numeric ? a - b : a.localeCompare(b, "en", { numeric: true }));
    button.addEventListener("click", () => {
      const turned = head.getAttribute("aria-sort") === "ascending" ? -1 : 1;
      for (const each of heads) each.removeAttribute("aria-sort");
      head.setAttribute("aria-sort", turned > 0 ? "ascending" : "descending");
      const rows = [...body.rows].map((row) => [key(row), row]);
      const last = ([value]) => Number.isNaN(value);
      rows.sort((a, b) => last(a) - last(b) || (last(a) ? 0 : turned * compare(a[0], b[0])));
      body.append(...rows.map(([, row]) => row));
    });
  });
}
