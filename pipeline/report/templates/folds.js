// The film plays unless the reader asked for less motion. Compressed data of the page, tables that are made when their fold is opened, links to them, and copies as CSV.
"use strict";
const embedded = (function () {
  const read = new Map(); // id of a block -> promise of its content
  async function unpack(id) {
    const packed = Uint8Array.from(atob(document.getElementById(id).textContent), (letter) => letter.charCodeAt(0));
    const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
    return JSON.parse(await new Response(stream).text());
  }
  return function (id) {
    if (!read.has(id)) read.set(id, unpack(id));
    return read.get(id);
  };
})();

(function () {
  const film = document.querySelector(".opening video");
  if (film && !matchMedia("(prefers-reduced-motion: reduce)").matches) film.play().catch(() => {}); // not allowed: its controls play it
})();

(function () {
  function element(kind, text, attributes) {
    const made = Object.assign(document.createElement(kind), attributes);
    if (text !== undefined) made.textContent = text;
    return made;
  }

  // A field with a comma, a quotation mark or a line break is quoted (RFC 4180).
  function csv(table) {
    const field = (cell) => {
      const text = (cell.dataset.value || cell.textContent).replace(/\u202f/g, " ").trim();
      return /[",\n]/.test(text) ? `"${text.replace(/"/g, '""')}"` : text;
    };
    return Array.from(table.rows, (row) => Array.from(row.cells, field).join(",")).join("\n") + "\n";
  }

  async function copy(text) {
    try {
      await navigator.clipboard.writeText(text);
    } catch (error) { // no permission, or a page that is not trusted
      const area = element("textarea", text);
      document.body.append(area);
      area.select();
      document.execCommand("copy");
      area.remove();
    }
  }

  function copyButton(text, label) {
    const button = element("button", label, { type: "button", className: "copy screen" });
    button.addEventListener("click", async () => {
      await copy(text());
      button.textContent = "copied";
      setTimeout(() => { button.textContent = label; }, 1200);
    });
    return button;
  }

  function tableOf(headers, rows) {
    const table = element("table"), head = table.createTHead().insertRow(), body = table.createTBody();
    const commands = headers.indexOf("run again");
    for (const header of headers) head.append(element("th", header, { scope: "col" }));
    for (const cells of rows) {
      const row = body.insertRow();
      row.dataset.row = cells[0];
      cells.forEach((text, column) => {
        const cell = element(column ? "td" : "th", column === commands ? undefined : text);
        if (!column) cell.scope = "row";
        if (column === commands) {
          cell.dataset.value = text;
          cell.append(element("code", text), " ", copyButton(() => text, "copy"));
        }
        row.append(cell);
      });
    }
    return table;
  }

  async function fill(fold) {
    if (fold.dataset.filled) return;
    fold.dataset.filled = "yes";
    const wide = element("div", undefined, { className: "wide" });
    fold.append(wide);
    try {
      const { headers, tables } = await embedded("table-data");
      const [kind, rows] = tables[fold.id];
      wide.append(tableOf(headers[kind], rows));
    } catch (error) {
      wide.append(element("p", `This browser cannot read the table: ${error.message}`, { className: "note" }));
    }
  }

  async function opened(fold) {
    if (fold.classList.contains("folded")) await fill(fold);
    if (fold.querySelector(":scope > button.copy")) return;
    const tables = Array.from(fold.querySelectorAll("table"));
    if (!tables.length) return;
    fold.querySelector("summary").after(copyButton(() => tables.map(csv).join("\n"), "copy as CSV"));
  }

  // Opens the fold that the address names, and marks the row that the link was about.
  async function follow(number) {
    const fold = document.getElementById(decodeURIComponent(location.hash.slice(1)));
    if (!fold || !fold.matches("details")) return;
    fold.open = true;
    await opened(fold);
    for (const row of fold.querySelectorAll("tr.marked")) row.classList.remove("marked");
    const row = number === undefined ? null : fold.querySelector(`tr[data-row="${number}"]`);
    if (row) row.classList.add("marked");
    (row || fold).scrollIntoView({ block: row ? "center" : "start", behavior: "instant" });
    fold.querySelector("summary").focus({ preventScroll: true });
  }

  for (const fold of document.querySelectorAll("details.folded, details.numbers")) {
    fold.addEventListener("toggle", () => { if (fold.open) opened(fold); });
  }
  let about; // number of the trial that the link followed last was about
  document.addEventListener("click", (event) => {
    const link = event.target.closest("a[href^='#']");
    if (!link) return;
    about = link.dataset.row;
    if (link.hash === location.hash) follow(about); // the address does not change, so nothing else tells
  });
  window.addEventListener("hashchange", () => { follow(about); about = undefined; });
  follow();

  // On paper, the numbers of every figure are open, and pictures stand that were never scrolled to.
  let closed = [];
  window.addEventListener("beforeprint", () => {
    closed = Array.from(document.querySelectorAll("details.numbers:not([open])"));
    for (const fold of closed) fold.open = true;
    for (const image of document.querySelectorAll("img[loading=lazy]")) image.loading = "eager";
  });
  window.addEventListener("afterprint", () => {
    for (const fold of closed) fold.open = false;
    closed = [];
  });
})();
