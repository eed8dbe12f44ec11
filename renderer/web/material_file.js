// Reads the file that "mesorig export web" writes. Its layout is described in
// processing/webgl/webgl_file.h and webgl_pack.h.

const magic = "mesoweb", version = "2";
const lengthAt = magic.length + version.length, headAt = lengthAt + 4;

const arrays = {
  clusters: Uint16Array,
  weights: Uint16Array, // halves
  scales: Float32Array,
  means: Uint16Array, // halves
  brdfs: Int8Array,
  surface: Uint8Array,
  heights: Uint8Array,
  planes: Float32Array,
  sky: Uint16Array, // halves
  network: Uint8Array, // text
  shell: Uint8Array,
  depths: Uint8Array,
  directions: Float32Array,
  triangles: Uint16Array,
};

async function inflate(bytes) {
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Response(stream).arrayBuffer();
}

// Checks the numbers of voxels and the lengths in the header, before a texture of this size is made.
function checkShell({ shell, data }) {
  const counts = [shell.width, shell.height, shell.depth];
  const lengths = [shell.width_mm, shell.height_mm, shell.depth_mm, shell.top_mm, shell.most_per_mm];
  const size = counts.every(n => Number.isInteger(n) && n > 0) ? counts[0] * counts[1] * counts[2] : 0;
  if (!data.shell || data.shell.length !== size || !lengths.every(x => Number.isFinite(x) && x >= 0) ||
      shell.width_mm === 0 || shell.height_mm === 0)
    throw new Error("The material is damaged: its shell does not have the size that the header gives; export the material again.");
}

// Checks the neural planes against the header, before textures of this size are made.
function checkNeural({ levels, neural, data }) {
  const [[w, h]] = levels, [columns, rows] = neural.sky, { surface, heights, planes, sky, network } = data;
  if (![w, h, columns, rows, neural.channels, neural.plane].every(n => Number.isInteger(n) && n > 0) || !network ||
      !surface || surface.length !== w * h * neural.channels || !heights || heights.length !== 4 * w * h ||
      !planes || planes.length !== 16 * neural.plane ** 2 || !sky || sky.length % (3 * columns * rows) !== 0 ||
      !neural.heights.every(x => Number.isFinite(x)))
    throw new Error("The material is damaged: its neural planes do not have the size that the header gives; export the material again.");
}

// Checks the views of the MDF against the header, before textures of this size are made.
function checkViews({ along, shell, data }) {
  const counts = [along.width, along.height, along.views];
  const size = counts.every(n => Number.isInteger(n) && n > 0) ? counts[0] * counts[1] * counts[2] : 0;
  const { depths, directions, triangles } = data;
  if (!shell || !depths || !directions || !triangles || depths.length !== size || directions.length !== 3 * along.views ||
      triangles.length === 0 || triangles.length % 3 !== 0 || triangles.some(k => k >= along.views) ||
      !directions.every(Number.isFinite))
    throw new Error("The material is damaged: its views do not have the number and size that the header gives; export the material again.");
}

// Resolves to the header, with its sections as typed arrays in "data". bytes is a Uint8Array.
// progress is called with the share that is done, from 0 to 1.
export async function readMaterial(bytes, progress = () => {}) {
  if (typeof DecompressionStream === "undefined")
    throw new Error("This browser cannot decompress the material; use one of 2023 or later.");
  const text = new TextDecoder();
  if (bytes.length < headAt || text.decode(bytes.subarray(0, magic.length)) !== magic)
    throw new Error("This is not a material that “mesorig export web” wrote.");
  const found = text.decode(bytes.subarray(magic.length, lengthAt));
  if (found !== version)
    throw new Error(`The material has version ${found} of the format, and only version ${version} can be read; ` +
      "export it again with “mesorig export web”.");
  const length = new DataView(bytes.buffer, bytes.byteOffset).getUint32(lengthAt, true);
  const material = JSON.parse(text.decode(bytes.subarray(headAt, headAt + length)));
  material.data = {};
  let at = headAt + length;
  const whole = Math.max(bytes.length - at, 1);
  for (const section of material.sections) {
    const part = bytes.subarray(at, at + section.bytes);
    const buffer = part.length === section.bytes ? await inflate(part) : new ArrayBuffer(0);
    if (buffer.byteLength !== section.size)
      throw new Error(`The material is damaged: its part “${section.name}” is incomplete; copy or download it again.`);
    const Kind = arrays[section.name];
    if (Kind) material.data[section.name] = new Kind(buffer);
    at += section.bytes;
    progress((at - headAt - length) / whole);
  }
  if (material.neural) checkNeural(material);
  if (material.shell) checkShell(material);
  if (material.along) checkViews(material);
  return material;
}

// Fetches a file and reads it with readMaterial().
export async function loadMaterial(url, progress = () => {}) {
  const answer = await fetch(url);
  if (!answer.ok) throw new Error(`The material ${url} cannot be loaded: ${answer.status} ${answer.statusText}`);
  return readMaterial(new Uint8Array(await answer.arrayBuffer()), progress);
}

// Returns the value of a half float that is given as 16 bits.
export function floatOfHalf(bits) {
  const sign = bits & 0x8000 ? -1 : 1, exponent = (bits >> 10) & 31, part = bits & 1023;
  if (exponent === 0) return sign * part * 2 ** -24;
  if (exponent === 31) return part ? NaN : sign * Infinity;
  return sign * (1 + part / 1024) * 2 ** (exponent - 15);
}
