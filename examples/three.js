// three.js: outlines of U.S. states as one ShapeGeometry, without and with flips.

import * as THREE from "three";
import flip from "flip-triangles";
import {recordDraw} from "./record-draw.js";
import {compare} from "./compare.js";

/* global OUTLINES -- from build.mjs: a list of rings for each outline, the outer ring first */

const SIZE = 1024; // of the drawing, as SIZE_PX of data.py

const path = (Kind, ring) => {
    const points = [];
    for (let i = 0; i < ring.length; i += 2) points.push(new THREE.Vector2(ring[i], ring[i + 1]));
    return new Kind(points);
};
const shapes = OUTLINES.map(([outer, ...holes]) => {
    const shape = path(THREE.Shape, outer);
    shape.holes = holes.map((ring) => path(THREE.Path, ring));
    return shape;
});

const renderer = new THREE.WebGLRenderer({antialias: false});
renderer.setPixelRatio(1);
renderer.setSize(SIZE, SIZE);
const camera = new THREE.OrthographicCamera(0, SIZE, SIZE, 0, -1, 1);

function draw(withFlips) {
    const geometry = new THREE.ShapeGeometry(shapes);
    if (withFlips) flip(geometry.index.array, geometry.attributes.position.array, {dimensions: 3});
    const scene = new THREE.Scene();
    scene.background = new THREE.Color(0xf4f1ea);
    scene.add(new THREE.Mesh(geometry, new THREE.MeshBasicMaterial({color: 0x4f7f6b, side: THREE.DoubleSide})));
    const matrices = ["projectionMatrix", "modelViewMatrix"];
    return recordDraw(renderer.getContext(), {attribute: "position", matrices, only: "modelViewMatrix"},
        () => renderer.render(scene, camera));
}

compare(draw(false), draw(true));
