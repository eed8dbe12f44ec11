#include "capture_calibration.h"

static void warn_of_age(const struct devices *devices, const struct calibration *calibration,
                        GPtrArray *warnings) {
    for (int i = 0; i < CALIBRATION_PARTS; i++) {
        double days = calibration_age_days(calibration, (enum calibration_kind)i);
        if (days <= devices->calibration_days)
            continue;
        g_ptr_array_add(warnings, g_strdup_printf("the calibration of %s in %s is %.0f days old; "
                                                  "“mesorig calibrate %s” renews it",
                                                  calibration_part_name((enum calibration_kind)i),
                                                  devices->calibration_path, days,
                                                  calibration_part_name((enum calibration_kind)i)));
    }
}

struct calibration *capture_calibration(const struct devices *devices, GPtrArray **ret_warnings,
                                        GError **error) {
    const char *path = devices->calibration_path;
    g_autoptr(GPtrArray) warnings = g_ptr_array_new_with_free_func(g_free);
    g_autoptr(Calibration) calibration = NULL;

    if (path && g_file_test(path, G_FILE_TEST_EXISTS)) {
        calibration = calibration_read(path, error);
        if (!calibration || !calibration_check_rig(calibration, path, &devices->geometry, error))
            return NULL;
        warn_of_age(devices, calibration, warnings);
    } else {
        calibration = calibration_new(&devices->geometry);
        if (path)
            g_ptr_array_add(warnings,
                            g_strdup_printf("%s is not there yet: geometry and light are those of "
                                            "the rig file",
                                            path));
    }
    *ret_warnings = g_steal_pointer(&warnings);
    return g_steal_pointer(&calibration);
}
