/* Download of the page's numbers as CSV: each section of the page adds a function to `tables` that returns its CSV text. */

const tables = {};

function quoteCsv(value) {
  if (value === null || value === undefined) return "";
  const text = String(value);
  return /[",\r\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
}

function csv(columns, rows) {
  return [columns, ...rows].map((row) => row.map(quoteCsv).join(",")).join("\r\n") + "\r\n";
}

function csvOfObjects(objects) {
  const columns = [...new Set(objects.flatMap((each) => Object.keys(each)))];
  return csv(columns, objects.map((each) => columns.map((name) => each[name])));
}

function addCsvButtons() {
  for (const button of document.querySelectorAll("[data-csv]")) {
    button.addEventListener("click", () => {
      const blob = new Blob([tables[button.dataset.csv]()], { type: "text/csv" });
      const link = element("a", {
        href: URL.createObjectURL(blob),
        download: `${button.dataset.csv}.csv`,
      });
      link.click();
      setTimeout(() => URL.revokeObjectURL(link.href), 1000);
    });
  }
}
