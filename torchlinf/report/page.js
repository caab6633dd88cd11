"use strict";
// Joins the parts of the page: filters, charts, the table and the profile. It is called with bokeh's models when all are drawn.
// Text of files is only ever set as textContent: it is never read as HTML.
function torchlinfReport(models) {
  const page = JSON.parse(document.getElementById("report-data").textContent);
  const element = (id) => document.getElementById(id);
  const {source, shown, stored, starts, lengths, bins, lines, dots, axes, table, histogram} = models;
  const rows = source.get_length();
  const columns = page.columns;
  const numeric = columns.filter((one) => one.isNumber);
  const byField = new Map(columns.map((one) => [one.field, one]));
  const fieldOf = (name) => (columns.find((one) => one.name === name) || {}).field;
  const score = fieldOf(page.windows[0]) || numeric[0].field;
  const errors = source.get(fieldOf("error"));
  const equal = fieldOf("equal") ? source.get(fieldOf("equal")) : null;
  const texts = Array.from(source.get("c0"), (path, i) => `${page.folder}${path}\n${errors[i]}`.toLowerCase());
  let visible = Array(rows).fill(true);

  function choose(id, chosen, changed) {
    const select = element(id);
    select.append(...numeric.map((one) => new Option(one.title, one.field, false, one.field === chosen)));
    select.addEventListener("change", changed);
    return select;
  }

  // The histogram: of all masks in grey, of those that pass the filter in colour.
  const histogramColumn = choose("histogram-column", score, () => {
    element("filter-min").value = element("filter-max").value = "";
    filter();
  });

  function drawHistogram() {
    const values = source.get(histogramColumn.value);
    let low = Infinity, high = -Infinity;
    for (const value of values) {
      if (Number.isFinite(value)) { low = Math.min(low, value); high = Math.max(high, value); }
    }
    if (low > high) { low = 0; high = 1; }
    if (low === high) { low -= 0.5; high += 0.5; }
    const count = 40, width = (high - low) / count;
    const all = new Float64Array(count), some = new Float64Array(count);
    values.forEach((value, i) => {
      if (!Number.isFinite(value)) return;
      const bin = Math.min(count - 1, Math.floor((value - low) / width));
      all[bin] += 1;
      if (visible[i]) some[bin] += 1;
    });
    const left = all.map((_, bin) => low + bin * width), right = all.map((_, bin) => low + (bin + 1) * width);
    bins.data = {left, right, all, shown: some};
    axes.histogram.axis_label = byField.get(histogramColumn.value).title;
    element("filter-column").textContent = `${byField.get(histogramColumn.value).title} from`;
  }

  histogram.on_event("selectiongeometry", (event) => {
    if (!event.final) return;
    const {x0, x1} = event.geometry;
    const round = (x) => Number(x.toPrecision(4));
    element("filter-min").value = round(Math.min(x0, x1));
    element("filter-max").value = round(Math.max(x0, x1));
    bins.selected.indices = [];
    filter();
  });

  // The filters.
  function filter() {
    const words = element("filter-text").value.trim().toLowerCase(), kind = element("filter-kind").value;
    const number = (id) => (element(id).value === "" ? null : Number(element(id).value));
    const low = number("filter-min"), high = number("filter-max");
    const values = source.get(histogramColumn.value), scores = source.get(score);
    const next = Array(rows);
    let count = 0;
    for (let i = 0; i < rows; i++) {
      next[i] = (!words || texts[i].includes(words))
        && (low === null || values[i] >= low) && (high === null || values[i] <= high)
        && (kind === "all" || (kind === "scored" && Number.isFinite(scores[i])) || (kind === "failed" && errors[i] !== "")
          || (kind === "equal" && equal !== null && equal[i] > 0) || (kind === "profile" && lengths[i] > 0));
      count += next[i];
    }
    visible = next;
    shown.booleans = next;
    element("filter-count").textContent = `${count.toLocaleString("en")} of ${rows.toLocaleString("en")} masks`;
    drawHistogram();
  }

  let waiting = null;
  for (const id of ["filter-text", "filter-kind", "filter-min", "filter-max"]) {
    element(id).addEventListener("input", () => {
      clearTimeout(waiting);
      waiting = setTimeout(filter, 100);
    });
  }

  function clear() {
    element("filter-text").value = element("filter-min").value = element("filter-max").value = "";
    element("filter-kind").value = "all";
    filter();
  }
  element("filter-clear").addEventListener("click", clear);

  // The scatter plot: fine against coarse where the table has both.
  const [across, up] = ["x", "y"].map((axis) => {
    const names = {x: "complexity_low", y: "complexity_high"};
    const windows = numeric.filter((one) => page.windows.includes(one.name));
    const fallback = {x: score, y: (windows[1] || numeric.find((one) => one.field !== score) || numeric[0]).field}[axis];
    const select = choose(`scatter-${axis}`, fieldOf(names[axis]) || fallback, () => draw());
    const draw = () => {
      for (const glyph of dots) glyph[axis] = {field: select.value};
      axes[axis].axis_label = byField.get(select.value).title;
    };
    draw();
    return select;
  });

  // Masks without a number stand behind all others, whichever way the table is sorted; bokeh would put them first one way.
  const grid = Bokeh.index.find_one(table).grid;
  for (const column of table.columns) {
    if (column.sorter === null) continue;
    column.sorter.compute = (a, b) => {
      const way = grid.getSortColumns().some((one) => !one.sortAsc) ? -1 : 1;
      return Number.isNaN(a) || Number.isNaN(b) ? way * (Number.isNaN(a) - Number.isNaN(b)) : a - b;
    };
  }

  // The profile of what is selected: steps, one a level.
  function profileOf(row) {
    const count = lengths[row], x = [], y = [];
    for (let k = 1; k <= count; k++) {
      const value = stored.get("levels")[starts[row] + k - 1] * page.step;
      x.push((k - 1) / count, k / count);
      y.push(value, value);
    }
    return {x, y};
  }

  const format = (value) => (Number.isInteger(value) ? value.toLocaleString("en")
    : Math.abs(value) < 1e-3 ? value.toExponential(2) : value.toFixed(6));

  function describe(selected) {
    const row = selected[0], body = element("detail-body");
    body.hidden = row === undefined;
    element("detail-hint").hidden = row !== undefined;
    element("detail-note").textContent = "";
    const drawn = selected.filter((one) => lengths[one] > 0).slice(0, page.lines.length);
    const profiles = drawn.map(profileOf);
    lines.data = {
      x: profiles.map((one) => one.x), y: profiles.map((one) => one.y),
      colour: drawn.map((_, i) => page.lines[i]), path: drawn.map((one) => source.get("c0")[one]),
    };
    // With several lines, a key says which is which.
    element("detail-key").replaceChildren(...(drawn.length > 1 ? drawn : []).map((one, i) => {
      const item = document.createElement("li"), line = document.createElement("i");
      line.style.background = page.lines[i];
      item.append(line, source.get("c0")[one]);
      return item;
    }));
    element("detail-profile").style.visibility = drawn.length ? "visible" : "hidden";
    if (row === undefined) return;
    element("detail-path").textContent = source.get("c0")[row];
    element("detail-error").textContent = errors[row];
    element("detail-error").hidden = !errors[row];
    element("detail-picture").hidden = !source.get("thumb")[row];
    element("detail-picture").src = source.get("thumb")[row] || "data:,";
    const numbers = numeric.filter((one) => Number.isFinite(source.get(one.field)[row])).flatMap((one) => {
      const name = document.createElement("dt"), value = document.createElement("dd");
      name.textContent = one.title;
      value.textContent = format(source.get(one.field)[row]);
      return [name, value];
    });
    element("detail-numbers").replaceChildren(...numbers);
    const more = selected.length > drawn.length && drawn.length === page.lines.length
      ? `The profiles of ${drawn.length} of ${selected.length} selected masks are drawn.` : "";
    element("detail-note").textContent = more || page.notes[row];
  }
  source.selected.properties.indices.change.connect(() => describe(source.selected.indices));

  for (const card of document.querySelectorAll("[data-row]")) {
    card.addEventListener("click", () => {
      const row = Number(card.dataset.row);
      if (!visible[row]) clear();
      source.selected.indices = [row];
      element("table-title").scrollIntoView({behavior: "smooth"});
    });
  }

  axes.profile.axis_label = `complexity (${page.unit})`;
  describe([]);
  filter();
  document.documentElement.dataset.ready = "true";
}
