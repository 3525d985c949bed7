// Build the examples into the folder that data.py has filled, each as a self-contained HTML file.

import {build} from "esbuild";
import {readdirSync, readFileSync, writeFileSync} from "node:fs";
import {dirname, join} from "node:path";
import {fileURLToPath} from "node:url";

const folder = process.argv[2];
const sources = dirname(fileURLToPath(import.meta.url));
const inside = (...parts) => join(sources, ...parts);
const countingScript = readFileSync(inside("..", "harness", "report", "static", "spans.js"), "utf8");

/** Replace imports of "earcut" by earcut with flips, except in the file that adds the flips. */
const flipped = {
    name: "flipped-earcut",
    setup({onResolve}) {
        onResolve({filter: /^earcut$/}, ({importer}) =>
            importer.endsWith("flipped-earcut.js") ? undefined : {path: inside("flipped-earcut.js")});
    },
};

/** The text of a script bundled with its imports. */
async function bundle(entry, plugins = []) {
    const {outputFiles: [file]} = await build({
        entryPoints: [inside(entry)], bundle: true, minify: true, write: false, plugins, format: "esm",
        target: "es2022", define: {"import.meta.url": '""'}, legalComments: "inline",
        tsconfigRaw: {compilerOptions: {useDefineForClassFields: false}}, // in MapLibre base classes set fields that subclasses declare
    });
    return file.text;
}

/* Write a page; the last of the scripts is a module. */
function writePage(name, values, scripts) {
    const inline = scripts.map((text) => text.replaceAll("</script", "<\\/script").replaceAll("<!--", "<\\!--"));
    values.scripts = `<script>${inline.slice(0, -1).join("\n")}</script>\n<script type="module">${inline.at(-1)}</script>`;
    const page = readFileSync(inside("page.html"), "utf8").replace(/{{(\w+)}}/g, (_, key) => values[key]);
    writeFileSync(join(folder, `${name}.html`), page);
    console.log(join(folder, `${name}.html`));
}

function readTiles() {
    const tiles = {};
    for (const file of readdirSync(join(folder, "tiles"), {recursive: true})) {
        if (file.endsWith(".pbf")) {
            const address = file.replaceAll("\\", "/").slice(0, -".pbf".length);
            tiles[address] = readFileSync(join(folder, "tiles", file), "base64");
        }
    }
    return tiles;
}

writePage("three", {
    title: "three.js: ShapeGeometry with flips",
    text: "Outlines of U.S. states as one ShapeGeometry. Between the pictures, one call of flip changed geometry.index.",
    window: "640 400 240",
    credit: "Outlines: U.S. Census Bureau, TIGER/Line Shapefiles.",
}, [countingScript, `const OUTLINES = ${readFileSync(join(folder, "states.json"), "utf8")};`, await bundle("three.js")]);

const worker = "node_modules/maplibre-gl/src/source/worker.ts";
const workers = {earcut: await bundle(worker), flipped: await bundle(worker, [flipped])};
writePage("maplibre", {
    title: "MapLibre GL JS: Helsinki with flips",
    text: "Four vector tiles of zoom 15. Between the pictures, the package earcut in MapLibre's workers was replaced by earcut with flips.",
    window: "300 300 240",
    credit: "Map: © OpenStreetMap contributors, ODbL 1.0.",
}, [countingScript, `const WORKERS = ${JSON.stringify(workers)}, TILES = ${JSON.stringify(readTiles())};`, await bundle("maplibre.js")]);
