// Checks MaterialX documents with a WebAssembly build of MaterialX, which web pages use: each document is valid, and
// is translated into a shader of WebGL.
//
//     node formats_materialx.mjs FOLDER FILE.mtlx…
//
// FOLDER is node_modules/@needle-tools/materialx/bin, as npm installs it. Exit status 1: a document failed.
import { readFileSync } from "node:fs";
import { createRequire } from "node:module";
import { pathToFileURL } from "node:url";

const MIN_LENGTH = 1000; // characters of a shader
const [folder, ...paths] = process.argv.slice(2);
globalThis.require = createRequire(import.meta.url); // the build expects to be a CommonJS module
globalThis.__dirname = folder;
const build = await import(pathToFileURL(`${folder}/JsMaterialXGenShader.js`));
const data = readFileSync(`${folder}/JsMaterialXGenShader.data.txt`);
const mx = await build.default({
    wasmBinary: readFileSync(`${folder}/JsMaterialXGenShader.wasm`),
    getPreloadedPackage: () => data.buffer.slice(data.byteOffset, data.byteOffset + data.length),
});
const generator = mx.EsslShaderGenerator.create();
const context = new mx.GenContext(generator);
const library = mx.loadStandardLibraries(context);

async function check(path) {
    const document = mx.createDocument();
    document.setDataLibrary(library);
    await mx.readFromXmlString(document, readFileSync(path, "utf8"), "");
    if (!document.validate()) return "not valid";
    const element = mx.findRenderableElement(document);
    const code = generator.generate(element.getNamePath(), element, context).getSourceCode("pixel");
    return code.length < MIN_LENGTH ? "no shader" : null;
}

let status = 0;
for (const path of paths) {
    const wrong = await check(path).catch((error) => `refused (${error})`);
    console.log(`${path}: ${wrong ?? "valid, with a shader"}`);
    if (wrong) status = 1;
}
process.exit(status);
