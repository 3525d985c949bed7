// What a program draws with WebGL: the triangles of its draw calls, read back from the GPU's buffers.

const UNIT = 256; // of a pixel

/**
 * Draw; return the picture, and the triangles that were drawn.
 *
 * @param {WebGL2RenderingContext} gl
 * @param {{attribute: string, matrices: string[], only: string}} shader in the vertex shader, the
 *     positions' name, and those of the matrices whose product takes positions to the clip space; and
 *     a uniform that no other program has than those whose triangles are wanted
 * @param {() => void} draw draws once, before it returns
 * @returns {{size: number[], pixels: Uint8Array, points: number[], triangles: number[]}} width and
 *     height; RGBA, the lowest row first; x, y in 1/256 px, y up; three indices a triangle
 */
export function drawn(gl, shader, draw) {
    const points = [], triangles = [];
    gl.drawElements = (...call) => {
        Object.getPrototypeOf(gl).drawElements.apply(gl, call);
        const program = gl.getParameter(gl.CURRENT_PROGRAM);
        const wanted = call[0] === gl.TRIANGLES && gl.getUniformLocation(program, shader.only);
        if (wanted) readCall(gl, program, shader, call, points, triangles);
    };
    try {
        draw();
    } finally {
        delete gl.drawElements;
    }
    const size = [gl.drawingBufferWidth, gl.drawingBufferHeight];
    const pixels = new Uint8Array(4 * size[0] * size[1]);
    gl.readPixels(0, 0, ...size, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
    return {size, pixels, points, triangles};
}

function readCall(gl, program, {attribute, matrices}, [, count, type, start], points, triangles) {
    const uniforms = matrices.map((name) => readMatrix(gl, program, name));
    const [, , width, height] = gl.getParameter(gl.VIEWPORT);
    const first = points.length / 2;
    for (const position of readPositions(gl, gl.getAttribLocation(program, attribute))) {
        const [x, y, , w] = uniforms.reduceRight(multiply, [...position, 0, 1]);
        points.push(Math.round((x / w + 1) / 2 * width * UNIT), Math.round((y / w + 1) / 2 * height * UNIT));
    }
    const Kind = {[gl.UNSIGNED_SHORT]: Uint16Array, [gl.UNSIGNED_INT]: Uint32Array}[type];
    const indices = new Kind(read(gl, gl.getParameter(gl.ELEMENT_ARRAY_BUFFER_BINDING)), start, count);
    for (const index of indices) triangles.push(first + index);
}

/** A matrix that is a uniform, or that lies in a buffer of uniforms. */
function readMatrix(gl, program, name) {
    const location = gl.getUniformLocation(program, name);
    if (location) return gl.getUniform(program, location);
    const uniform = gl.getUniformIndices(program, [name]);
    const [block] = gl.getActiveUniforms(program, uniform, gl.UNIFORM_BLOCK_INDEX);
    const [offset] = gl.getActiveUniforms(program, uniform, gl.UNIFORM_OFFSET);
    const binding = gl.getActiveUniformBlockParameter(program, block, gl.UNIFORM_BLOCK_BINDING);
    const start = gl.getIndexedParameter(gl.UNIFORM_BUFFER_START, binding);
    const buffer = gl.getIndexedParameter(gl.UNIFORM_BUFFER_BINDING, binding);
    return new Float32Array(read(gl, buffer), start + offset, 16);
}

function* readPositions(gl, location) {
    const tell = (what) => gl.getVertexAttrib(location, what);
    const Kind = {[gl.SHORT]: Int16Array, [gl.FLOAT]: Float32Array}[tell(gl.VERTEX_ATTRIB_ARRAY_TYPE)];
    const buffer = read(gl, tell(gl.VERTEX_ATTRIB_ARRAY_BUFFER_BINDING));
    const size = tell(gl.VERTEX_ATTRIB_ARRAY_SIZE);
    const stride = tell(gl.VERTEX_ATTRIB_ARRAY_STRIDE) || size * Kind.BYTES_PER_ELEMENT;
    const begin = gl.getVertexAttribOffset(location, gl.VERTEX_ATTRIB_ARRAY_POINTER);
    for (let at = begin; at + stride <= buffer.byteLength; at += stride) yield new Kind(buffer, at, 2);
}

function read(gl, buffer) {
    const bound = gl.getParameter(gl.COPY_READ_BUFFER_BINDING);
    gl.bindBuffer(gl.COPY_READ_BUFFER, buffer);
    const content = new Uint8Array(gl.getBufferParameter(gl.COPY_READ_BUFFER, gl.BUFFER_SIZE));
    gl.getBufferSubData(gl.COPY_READ_BUFFER, 0, content);
    gl.bindBuffer(gl.COPY_READ_BUFFER, bound);
    return content.buffer;
}

/** The product of a vector and a matrix of four columns. */
const multiply = (v, m) => [0, 1, 2, 3].map((row) => v.reduce((sum, value, column) => sum + m[4 * column + row] * value, 0));
