/* Files of the positions of lamps: each input is read as a list (.lp) and as a table. */
#include "fuzz.h"

#include "rig/lamp_places.h"

static void read_as(const char *name, double distance_mm, const uint8_t *data, size_t size) {
    const char *path = fuzz_file_in_folder(name, data, size);
    const struct lamp_place otherwise = {
        .index = -1, .distance_mm = distance_mm, .exponent = 1, .intensity = 1};
    GError *error = NULL;
    g_autoptr(GArray) lamps = lamp_places_read(path, &otherwise, &error);
    fuzz_check(lamps != NULL, &error);
    if (!lamps)
        return;
    g_assert_cmpuint(lamps->len, >=, 1);
    g_assert_cmpuint(lamps->len, <=, RIG_MAX_LAMPS);
    for (guint i = 0; i < lamps->len; i++) {
        const struct lamp_place *lamp = &g_array_index(lamps, struct lamp_place, i);
        g_assert_true(lamp->theta_deg >= 0 && lamp->theta_deg < 90);
        g_assert_true(lamp->phi_deg >= -360 && lamp->phi_deg <= 360);
        g_assert_true(lamp->distance_mm >= 1 && lamp->distance_mm <= 1e5);
        g_assert_true(lamp->exponent >= 0 && lamp->intensity > 0);
        g_assert_true(lamp->index >= -1 && lamp->index <= 1023);
        g_assert_true(g_utf8_validate(lamp->name, -1, NULL));
        g_assert_true(g_utf8_validate(lamp->bank, -1, NULL));
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    read_as("lamps.lp", 0, data, size);
    read_as("lamps.lp", 400, data, size);
    read_as("lamps.csv", 0, data, size);
    read_as("lamps.csv", 400, data, size);
    return 0;
}
