// Builds a page that draws one tile: node build.mjs ZOOM/X/Y LAYER,... TILE.pbf PAGE.html

import {readFileSync, writeFileSync} from "node:fs";
import {createRequire} from "node:module";
import {dirname, join} from "node:path";
import {fileURLToPath} from "node:url";

const [place, layers, tile, page] = process.argv.slice(2);
const here = dirname(fileURLToPath(import.meta.url));
const modules = join(here, "..", "..", "..", "examples", "node_modules");
const {build} = createRequire(join(modules, "any.js"))("esbuild");

/** The text of one script, with all that it imports. */
async function bundle(entry) {
    const {outputFiles: [file]} = await build({
        entryPoints: [entry], bundle: true, minify: true, write: false, format: "esm", target: "es2022",
        define: {"import.meta.url": '""'}, nodePaths: [modules],
        tsconfigRaw: {compilerOptions: {useDefineForClassFields: false}}, // MapLibre's base classes set fields that others declare
    });
    return file.text;
}

const inline = (text) => text.replaceAll("</script", "<\\/script").replaceAll("<!--", "<\\!--");
const values = {
    WORKER: await bundle(join(modules, "maplibre-gl", "src", "source", "worker.ts")),
    PLACE: place.split("/").map(Number),
    TILE: readFileSync(tile, "base64"),
    LAYERS: layers.split(","),
};
const known = Object.entries(values).map(([name, value]) => `const ${name} = ${JSON.stringify(value)};`);
writeFileSync(page, `<!doctype html><meta charset="utf-8"><div id="map" style="width:512px;height:512px"></div>
<script>${inline(known.join("\n"))}</script>
<script type="module">${inline(await bundle(join(here, "map.js")))}</script>
`);
