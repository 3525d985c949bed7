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
