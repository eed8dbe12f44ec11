// Prints what Khronos's validator has to say about glTF files; exits with 1 for any error or warning.
// usage: NODE_PATH=… node validate.js FILE…
const fs = require('fs'), path = require('path'), validator = require('gltf-validator');

async function validate(file) {
    const report = await validator.validateBytes(new Uint8Array(fs.readFileSync(file)), {
        externalResourceFunction: uri => Promise.resolve(
            new Uint8Array(fs.readFileSync(path.join(path.dirname(file), decodeURIComponent(uri)))))
    });
    const {numErrors, numWarnings, numInfos, messages} = report.issues;
    console.log(`${file}: ${numErrors} errors, ${numWarnings} warnings, ${numInfos} infos`);
    for (const m of messages)
        console.log(`  ${m.code} ${m.pointer}: ${m.message}`);
    return numErrors + numWarnings;
}

(async () => {
    let bad = 0;
    for (const file of process.argv.slice(2))
        bad += await validate(file);
    process.exit(bad > 0 ? 1 : 0);
})();
