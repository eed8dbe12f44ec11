// Reads the file that "mesorig export web" writes. Its layout is described in
// processing/webgl/webgl_file.h and webgl_pack.h.

const magic = "mesoweb1";
const headAt = magic.length + 4;

const arrays = {
  clusters: Uint16Array,
  weights: Uint16Array, // halves
  scales: Float32Array,
  means: Uint16Array, // halves
  brdfs: Int8Array,
  mdf_maps: Uint8Array,
  mdf_factors: Uint16Array, // halves
};

async function inflate(bytes) {
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Response(stream).arrayBuffer();
}

// Resolves to the header, with its sections as typed arrays in "data". bytes is a Uint8Array.
// progress is called with the share that is done, from 0 to 1.
export async function readMaterial(bytes, progress = () => {}) {
  if (typeof DecompressionStream === "undefined")
    throw new Error("This browser cannot decompress the material; use one of 2023 or later.");
  const text = new TextDecoder();
  if (bytes.length < headAt || text.decode(bytes.subarray(0, magic.length)) !== magic)
    throw new Error("This is not a material that “mesorig export web” wrote.");
  const length = new DataView(bytes.buffer, bytes.byteOffset).getUint32(magic.length, true);
  const material = JSON.parse(text.decode(bytes.subarray(headAt, headAt + length)));
  material.data = {};
  let at = headAt + length;
  const whole = Math.max(bytes.length - at, 1);
  for (const section of material.sections) {
    const part = bytes.subarray(at, at + section.bytes);
    const buffer = part.length === section.bytes ? await inflate(part) : new ArrayBuffer(0);
    if (buffer.byteLength !== section.size)
      throw new Error(`The material is damaged: its part “${section.name}” is incomplete.`);
    const Kind = arrays[section.name];
    if (Kind) material.data[section.name] = new Kind(buffer);
    at += section.bytes;
    progress((at - headAt - length) / whole);
  }
  return material;
}

// Fetches a file and reads it with readMaterial().
export async function loadMaterial(url, progress = () => {}) {
  const answer = await fetch(url);
  if (!answer.ok) throw new Error(`${url}: ${answer.status} ${answer.statusText}`);
  return readMaterial(new Uint8Array(await answer.arrayBuffer()), progress);
}

export function floatOfHalf(bits) {
  const sign = bits & 0x8000 ? -1 : 1, exponent = (bits >> 10) & 31, part = bits & 1023;
  if (exponent === 0) return sign * part * 2 ** -24;
  if (exponent === 31) return part ? NaN : sign * Infinity;
  return sign * (1 + part / 1024) * 2 ** (exponent - 15);
}
