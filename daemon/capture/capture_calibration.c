#include "capture_calibration.h"

#include "base/config.h"

#include <gio/gio.h>
#include <math.h>

struct calibration *capture_calibration(const struct devices *devices, GPtrArray **ret_warnings,
                                        GError **error) {
    const char *path = devices->calibration_path;
    g_autoptr(GPtrArray) warnings = g_ptr_array_new_with_free_func(g_free);
    g_autoptr(Calibration) calibration = NULL;
    const char *text = devices->calibration_text;
    if (path && (text || g_file_test(path, G_FILE_TEST_EXISTS))) {
        calibration =
            text ? calibration_from_text(text, path, error) : calibration_read(path, error);
        if (!calibration || !calibration_check_rig(calibration, path, &devices->geometry, error))
            return NULL;
        for (int i = 0; i < CALIBRATION_PARTS; i++) {
            const char *part = calibration_part_name((enum calibration_kind)i);
            double days = calibration_age_days(calibration, (enum calibration_kind)i);
            if (days > devices->calibration_days)
                g_ptr_array_add(warnings,
                                g_strdup_printf("the calibration of %s in %s is %.0f days old; "
                                                "“mesorig calibrate %s” renews it",
                                                part, path, days, part));
        }
    } else {
        calibration = calibration_new(&devices->geometry);
        if (path)
            g_ptr_array_add(
                warnings,
                g_strdup_printf(
                    "%s does not exist yet: geometry and light are those of the rig file", path));
    }
    *ret_warnings = g_steal_pointer(&warnings);
    return g_steal_pointer(&calibration);
}

struct calibration *capture_calibration_for(const char *rig_path, const struct rig *geometry,
                                            const char *path, const char *text, char **ret_line,
                                            GError **error) {
    g_autoptr(Config) config = config_load(rig_path, error);
    g_autoptr(GPtrArray) warnings = NULL;
    if (!config)
        return NULL;
    const struct config_section *section = config_find(config, "rig", NULL);
    const char *named = section ? config_value(section, "calibration", NULL) : NULL;
    g_autofree char *from = path              ? g_canonicalize_filename(path, NULL)
                            : named && *named ? config_resolve(config, named)
                                              : NULL;
    const struct devices devices = {.geometry = *geometry,
                                    .calibration_path = from,
                                    .calibration_text = text,
                                    .calibration_days = INFINITY};
    struct calibration *calibration = capture_calibration(&devices, &warnings, error);
    if (calibration)
        *ret_line = calibration_line(calibration, from, CAPTURE_CALIBRATION_HOW);
    return calibration;
}

char *capture_calibration_line(const char *rig_path, const char *path, GError **error) {
    struct rig geometry;
    char *line = NULL;
    g_autoptr(Calibration) calibration =
        devices_read_geometry(rig_path, &geometry, error)
            ? capture_calibration_for(rig_path, &geometry, path, NULL, &line, error)
            : NULL;
    return line;
}
