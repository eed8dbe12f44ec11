/* Rig files: every section, marks among them, and every driver's options. */
#include "fuzz.h"

#include "rig/devices.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    g_autofree char *text = fuzz_text(data, size);
    g_autofree struct rig *rig = g_new0(struct rig, 1);
    GError *error = NULL;
    fuzz_check(devices_parse_geometry(text, "fuzz", rig, &error), &error);
    return 0;
}
