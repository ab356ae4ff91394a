// Values stand at the cursor. With the tools shown, a stretch of curves that is dragged over, or set
// by the sliders, fills the picture, and a curve can be hidden. Without this script, and in print, the whole picture stands.
// Scales, linear or logarithmic, are straight in pixels: a viewBox moves what matplotlib drew.
const NARROWEST = 0.02;
const numbers = (text) => text.match(/-?\d*\.?\d+/g).map(Number);
const raised = (e) => [...`${+e}`].map((c) => "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"["-0123456789".indexOf(c)]).join("");
const written = (v, digits) => {
  const rounded = +v.toPrecision(digits), small = rounded && Math.abs(rounded) < 1e-3;
  const [size, power] = `${small ? rounded.toExponential() : rounded}`.split("e");
  return size.replace("-", "−") + (power ? `·10${raised(power)}` : "");
};
const make = (of, name, looks, text = "") => {
  const node = of.appendChild(document.createElementNS(of.namespaceURI, name));
  for (const key in looks) node.setAttribute(key, looks[key]);
  node.append(text);
  return node;
};
// Powers of ten where there are some, else round numbers.
const ticks = (log, a, b) => {
  const first = Math.floor(Math.log10(a)), size = 10 ** Math.floor(Math.log10((b - a) / 3));
  const step = size * [5, 2, 1].find((m) => m === 1 || b - a >= 3 * m * size);
  const finer = b < 100 * a ? [1, 2, 5] : [1], n = finer.length;
  const power = (i) => finer[i % n] * 10 ** (first + Math.floor(i / n));
  const at = (i) => (log && b > 5 * a ? power(i) : (Math.ceil(a / step) + i) * step);
  return Array.from({ length: 60 }, (_, i) => at(i)).filter((v) => v >= a && v <= b);
};
// An axis from pixel to pixel, and its ticks over a stretch in the look of the first that stands.
const axis = (node, start, end, scale, ...ends) => {
  const log = scale === "log", [low, high] = ends.map((v) => (log ? Math.log10(v) : +v));
  const value = (p) => ((v) => (log ? 10 ** v : v))(low + ((p - start) / (end - start)) * (high - low));
  const place = (v) => start + (((log ? Math.log10(v) : v) - low) / (high - low)) * (end - start);
  const k = node.dataset.axis, pattern = node.querySelector(":scope > g:has(path)");
  const show = (from, to, zoomed) => {
    node.querySelectorAll(".tick").forEach((old) => old.remove());
    for (const v of zoomed && pattern ? ticks(log, value(from), value(to)) : []) {
      const tick = node.appendChild(pattern.cloneNode(true)), text = tick.querySelector("text");
      const line = tick.querySelector("path"), was = numbers(line.getAttribute("d"))[k === "x" ? 0 : 1];
      const by = start + ((place(v) - from) / (to - from)) * (end - start) - was;
      tick.setAttribute("class", "tick");
      tick.setAttribute("transform", k === "x" ? `translate(${by} 0)` : `translate(0 ${by})`);
      line.removeAttribute("clip-path");
      if (text) text.textContent = written(v, 6);
    }
  };
  return { value, show, label: node.querySelector(":scope > g:not(:has(path)) > text")?.textContent ?? "" };
};
const area = (group) => {
  const marks = [...group.querySelectorAll(":scope > g:has([clip-path]):not([data-axis])")];
  const clip = group.querySelector("[clip-path]").getAttribute("clip-path").slice(5, -1);
  const frame = document.getElementById(clip).firstElementChild;
  const [x, y, width, height] = ["x", "y", "width", "height"].map((k) => +frame.getAttribute(k));
  const inner = make(group, "svg", { x, y, width, height, preserveAspectRatio: "none" });
  marks[0]?.before(inner);
  inner.append(...marks);
  const drawn = (m) => m.dataset.curve && m.firstElementChild.style.fill === "none";
  const lines = marks.filter((m) => drawn(m) && m.firstElementChild.getAttribute("d").trim());
  const curves = lines.map((mark) => {
    const at = numbers(mark.firstElementChild.getAttribute("d"));
    return { mark, points: at.flatMap((p, i) => (i % 2 ? [] : [[p, at[i + 1]]])) };
  });
  const about = group.dataset.area.split(" "), [h, v] = group.querySelectorAll("[data-axis]");
  const axes = [axis(h, x, x + width, ...about.slice(0, 3)), axis(v, y + height, y, ...about.slice(3))];
  return { x, y, width, height, inner, curves, axes, cursor: make(group, "path", { class: "cursor" }) };
};
// Make a picture's tools; return what shows it whole.
const tools = (svg, bar) => {
  const areas = [...svg.querySelectorAll("[data-area]")].map(area);
  const marked = [...svg.querySelectorAll("[data-curve]")], names = new Set(marked.map((m) => m.dataset.curve));
  const input = (name, looks) => make(make(bar, "label", {}, name), "input", looks);
  const [from, to, cursor] = ["from", "to", "values at"].map((name) =>
    input(name, { type: "range", min: 0, max: 1, step: "any" }));
  const boxes = [...names].map((value) => input(value, { type: "checkbox", value }));
  const output = make(bar, "output");
  const shown = (curves) => curves.filter(({ mark }) => !mark.hasAttribute("hidden"));
  // where a stretch begins while it is dragged over
  let start = null;
  const show = ({ x, y, width, height, inner, curves, axes, cursor: line }, u, v, zoomed) => {
    const c = +cursor.value, left = x + u * width, right = x + v * width, p = left + c * (right - left);
    // areas side by side have one height, that of what is seen in them
    const seen = areas.filter((a) => a.y === y && zoomed).flatMap((a) => shown(a.curves)
      .flatMap(({ points }) => points.filter(([q]) => q >= a.x + u * a.width && q <= a.x + v * a.width))
      .map(([, q]) => q));
    const ends = seen.length ? [Math.min(...seen), Math.max(...seen)] : [y, y + height];
    const more = 0.06 * (ends[1] - ends[0]) + 1;
    const [top, bottom] = [Math.max(ends[0] - more, y), Math.min(ends[1] + more, y + height)];
    inner.setAttribute("viewBox", [left, top, right - left, bottom - top].join(" "));
    axes[0].show(left, right, zoomed);
    axes[1].show(bottom, top, zoomed);
    line.setAttribute("d", `M${x + (start ?? c) * width} ${y}v${height}H${x + c * width}v${-height}z`);
    const said = shown(curves).map(({ mark, points }) => {
      const [, q] = points.reduce((m, q) => (Math.abs(q[0] - p) < Math.abs(m[0] - p) ? q : m));
      return `${mark.dataset.curve} ${written(axes[1].value(q), 3)}`;
    });
    const at = axes[0].label && `${axes[0].label} ${written(axes[0].value(p), 4)}. `;
    return `${at}${axes[1].label && `${axes[1].label}: `}${said.join(", ")}`;
  };
  const draw = () => {
    const u = Math.min(from.value, 1 - NARROWEST), v = Math.max(to.value, u + NARROWEST);
    const zoomed = v - u < 1 || boxes.some((b) => !b.checked);
    [from.value, to.value] = [u, v];
    svg.classList.toggle("zoomed", zoomed);
    for (const m of marked) m.toggleAttribute("hidden", !boxes.find((b) => b.value === m.dataset.curve).checked);
    output.textContent = areas.map((a) => show(a, u, v, zoomed)).join("\n");
  };
  const whole = () => {
    [from.value, to.value, cursor.value] = [0, 1, 0.5];
    for (const box of boxes) box.checked = true;
    draw();
  };
  const pointed = (event) => {
    const { x, y } = new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse());
    const a = areas.find((a) => x >= a.x && x <= a.x + a.width && y >= a.y && y <= a.y + a.height);
    const over = Boolean(a) && event.type !== "pointerleave" && event.pointerType !== "touch";
    for (const each of [bar, svg]) each.classList.toggle("read", over && bar.hidden);
    if (!over) return;
    const [u, v, s] = [+from.value, +to.value, (x - a.x) / a.width];
    if (event.type === "pointerdown" && !bar.hidden) start = s;
    if (event.type === "pointermove" && !event.buttons) start = null;
    if (event.type === "pointerup" && start !== null && Math.abs(s - start) > 0.01)
      [from.value, to.value] = [Math.min(s, start), Math.max(s, start)].map((w) => u + w * (v - u));
    if (event.type === "pointerup") start = null;
    cursor.value = s;
    draw();
  };
  for (const name of ["pointerdown", "pointermove", "pointerup", "pointerleave"]) svg.addEventListener(name, pointed);
  svg.addEventListener("dblclick", () => bar.hidden || whole());
  bar.addEventListener("input", draw);
  return whole;
};
const pictures = [...document.querySelectorAll("figure svg:has([data-area])")].map((svg) => {
  const caption = svg.closest("figure").querySelector("figcaption"), bar = document.createElement("div");
  Object.assign(bar, { className: "tools", hidden: true });
  caption.before(bar);
  const button = make(caption, "button", { type: "button", "aria-expanded": false }, "Zoom");
  let whole = null;
  const turn = (shown) => {
    if (shown) whole ??= tools(svg, bar);
    bar.hidden = !shown;
    button.setAttribute("aria-expanded", shown);
    svg.classList.toggle("open", shown);
    whole?.();
  };
  button.addEventListener("click", () => turn(bar.hidden));
  // values stand at the pointer before anything is clicked
  svg.addEventListener("pointerenter", () => { (whole ??= tools(svg, bar))(); }, { once: true });
  return turn;
});
addEventListener("beforeprint", () => pictures.forEach((turn) => turn(false)));
