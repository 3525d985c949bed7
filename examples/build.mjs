// Builds the examples into the folder that data.py has filled. Each is one HTML file, with all that it needs.

import {build} from "esbuild";
import {readdirSync, readFileSync, writeFileSync} from "node:fs";
import {dirname, join} from "node:path";
import {fileURLToPath} from "node:url";

const folder = process.argv[2];
const here = dirname(fileURLToPath(import.meta.url));
const inside = (...parts) => join(here, ...parts);
const counter = readFileSync(inside("..", "harness", "report", "static", "spans.js"), "utf8");

/** Whoever imports "earcut" gets earcut with flips; but for the file that adds the flips. */
const flipped = {
    name: "flipped-earcut",
    setup({onResolve}) {
        onResolve({filter: /^earcut$/}, ({importer}) =>
            importer.endsWith("flipped-earcut.js") ? undefined : {path: inside("flipped-earcut.js")});
    },
};

/** The text of one script, with all that it imports. */
async function bundle(entry, plugins = []) {
    const {outputFiles: [file]} = await build({
        entryPoints: [inside(entry)], bundle: true, minify: true, write: false, plugins, format: "esm",
        target: "es2022", define: {"import.meta.url": '""'}, legalComments: "inline",
        tsconfigRaw: {compilerOptions: {useDefineForClassFields: false}}, // MapLibre's base classes set fields that others declare
    });
    return file.text;
}

function writePage(name, values, scripts) {
    const inline = scripts.map((text) => text.replaceAll("</script", "<\\/script").replaceAll("<!--", "<\\!--"));
    values.scripts = `<script>${inline.slice(0, -1).join("\n")}</script>\n<script type="module">${inline.at(-1)}</script>`;
    const page = readFileSync(inside("page.html"), "utf8").replace(/{{(\w+)}}/g, (_, key) => values[key]);
    writeFileSync(join(folder, `${name}.html`), page);
    console.log(join(folder, `${name}.html`));
}

function tiles() {
    const found = {};
    for (const file of readdirSync(join(folder, "tiles"), {recursive: true})) {
        if (file.endsWith(".pbf")) {
            const place = file.replaceAll("\\", "/").slice(0, -".pbf".length);
            found[place] = readFileSync(join(folder, "tiles", file), "base64");
        }
    }
    return found;
}

writePage("three", {
    title: "three.js: ShapeGeometry with flips",
    text: "Outlines of U.S. states as one ShapeGeometry. Between the pictures, one call of flip changed geometry.index.",
    window: "640 400 240",
    credit: "Outlines: U.S. Census Bureau, TIGER/Line Shapefiles.",
}, [counter, `const OUTLINES = ${readFileSync(join(folder, "states.json"), "utf8")};`, await bundle("three.js")]);

const worker = "node_modules/maplibre-gl/src/source/worker.ts";
const workers = {earcut: await bundle(worker), flipped: await bundle(worker, [flipped])};
writePage("maplibre", {
    title: "MapLibre GL JS: Helsinki with flips",
    text: "Four vector tiles of zoom 15. Between the pictures, the package earcut in MapLibre's workers was replaced by earcut with flips.",
    window: "300 300 240",
    credit: "Map: © OpenStreetMap contributors, ODbL 1.0.",
}, [counter, `const WORKERS = ${JSON.stringify(workers)}, TILES = ${JSON.stringify(tiles())};`, await bundle("maplibre.js")]);
