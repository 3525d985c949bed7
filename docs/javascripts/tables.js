// A click on a heading sorts its table: numbers by their value, what is empty last.
for (const heading of document.querySelectorAll("article table th")) {
    heading.style.cursor = "pointer";
    heading.addEventListener("click", () => {
        const body = heading.closest("table").querySelector("tbody");
        const place = heading.cellIndex;
        const down = (heading.dataset.down = heading.dataset.down === "1" ? "0" : "1") === "0" ? -1 : 1;
        const key = (row) => row.cells[place].textContent.trim();
        const rows = [...body.rows].sort((a, b) => {
            const [x, y] = [key(a), key(b)];
            if (!x || !y) return x ? -1 : y ? 1 : 0;
            const [p, q] = [parseFloat(x), parseFloat(y)];
            return down * (isNaN(p) || isNaN(q) ? x.localeCompare(y) : p - q);
        });
        body.append(...rows);
    });
}

// A table wider than its page becomes a list: a block for each row, a line for each cell.
const tables = [...document.querySelectorAll("article table")].filter((table) => table.tHead);
for (const table of tables) {
    const labels = [...table.tHead.rows[0].cells].map((cell) => cell.textContent.trim());
    for (const row of table.tBodies[0].rows) {
        [...row.cells].forEach((cell, index) => (cell.dataset.label = labels[index]));
    }
}
function stack() {
    const page = document.querySelector("article").clientWidth;
    for (const table of tables) {
        table.removeAttribute("class"); // the theme draws tables without this attribute only
        if (table.scrollWidth > page) table.className = "stacked";
    }
}
stack();
addEventListener("resize", stack);
