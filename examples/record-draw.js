// Record what a program draws with WebGL: the triangles of draw calls, read back from GPU buffers.

const SUBPIXEL = 256; // units per pixel

/**
 * Draw once; return the picture and the drawn triangles.
 *
 * @param {WebGL2RenderingContext} gl
 * @param {{attribute: string, matrices: string[], only: string}} shader names in the vertex shader:
 *     the attribute with positions, the matrices whose product maps positions to clip space, and a
 *     uniform that only the programs to record have
 * @param {() => void} draw draws once, synchronously
 * @returns {{size: number[], pixels: Uint8Array, points: number[], triangles: number[]}} width and
 *     height; RGBA, bottom row first; x, y in 1/256 px, y up; three indices per triangle
 */
export function recordDraw(gl, shader, draw) {
    const points = [], triangles = [];
    gl.drawElements = (...call) => {
        Object.getPrototypeOf(gl).drawElements.apply(gl, call);
        const program = gl.getParameter(gl.CURRENT_PROGRAM);
        const isSelected = call[0] === gl.TRIANGLES && gl.getUniformLocation(program, shader.only);
        if (isSelected) readCall(gl, program, shader, call, points, triangles);
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
        points.push(Math.round((x / w + 1) / 2 * width * SUBPIXEL), Math.round((y / w + 1) / 2 * height * SUBPIXEL));
    }
    const Kind = {[gl.UNSIGNED_SHORT]: Uint16Array, [gl.UNSIGNED_INT]: Uint32Array}[type];
    const indices = new Kind(read(gl, gl.getParameter(gl.ELEMENT_ARRAY_BUFFER_BINDING)), start, count);
    for (const index of indices) triangles.push(first + index);
}

/** A matrix from a uniform or from a uniform buffer. */
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
    const getParameter = (parameter) => gl.getVertexAttrib(location, parameter);
    const Kind = {[gl.SHORT]: Int16Array, [gl.FLOAT]: Float32Array}[getParameter(gl.VERTEX_ATTRIB_ARRAY_TYPE)];
    const buffer = read(gl, getParameter(gl.VERTEX_ATTRIB_ARRAY_BUFFER_BINDING));
    const size = getParameter(gl.VERTEX_ATTRIB_ARRAY_SIZE);
    const stride = getParameter(gl.VERTEX_ATTRIB_ARRAY_STRIDE) || size * Kind.BYTES_PER_ELEMENT;
    const firstOffset = gl.getVertexAttribOffset(location, gl.VERTEX_ATTRIB_ARRAY_POINTER);
    const end = buffer.byteLength - size * Kind.BYTES_PER_ELEMENT; // of interleaved attributes, the last has no stride after it
    for (let offset = firstOffset; offset <= end; offset += stride) yield new Kind(buffer, offset, 2);
}

function read(gl, buffer) {
    const bound = gl.getParameter(gl.COPY_READ_BUFFER_BINDING);
    gl.bindBuffer(gl.COPY_READ_BUFFER, buffer);
    const content = new Uint8Array(gl.getBufferParameter(gl.COPY_READ_BUFFER, gl.BUFFER_SIZE));
    gl.getBufferSubData(gl.COPY_READ_BUFFER, 0, content);
    gl.bindBuffer(gl.COPY_READ_BUFFER, bound);
    return content.buffer;
}

/** The product of a vector and a matrix in column-major order. */
const multiply = (v, m) => [0, 1, 2, 3].map((row) => v.reduce((sum, value, column) => sum + m[4 * column + row] * value, 0));
