/* Tests a program that is a device as every driver is tested:
 *
 *     program_conformance lamps|axis|camera [KEY=VALUE …] PROGRAM [ARGUMENT …]
 *
 * KEY=VALUE are further keys of the section, such as speed_deg_s=20. The lamps are switched on, the
 * axis is moved, and the camera takes pictures. */
#include "conformance/conformance.h"
#include "program/devices.h"

#include <string.h>

static const char *const classes[] = {"lamps", "axis", "camera", NULL};

static gboolean is_key(const char *argument) {
    return strchr(argument, '=') && !strchr(argument, '/');
}

/* Returns a section that runs the program, whose path may be relative. */
static char *section_of(const char *class_name, char **arguments) {
    GString *text = g_string_new(NULL);
    g_string_printf(text, "[%s test]\ndriver = program-%s\n", class_name, class_name);
    for (; *arguments && is_key(*arguments); arguments++)
        g_string_append_printf(text, "%s\n", *arguments);
    if (!*arguments) {
        g_string_free(text, TRUE);
        return NULL;
    }
    g_autofree char *program = g_canonicalize_filename(*arguments, NULL);
    g_autofree char *others = g_strjoinv(";", arguments + 1);
    g_string_append_printf(text, "program = %s\narguments = %s\n", program, others);
    return g_string_free(text, FALSE);
}

int main(int argc, char **argv) {
    g_test_init(&argc, &argv, NULL);
    const gboolean known = argc > 2 && g_strv_contains(classes, argv[1]);
    g_autofree char *section = known ? section_of(argv[1], argv + 2) : NULL;
    const struct conformance with = {.name = "program", .section = section, .real_clock = TRUE};
    if (!section) {
        g_printerr("usage: %s lamps|axis|camera [KEY=VALUE …] PROGRAM [ARGUMENT …]\n", argv[0]);
        return 2;
    }
    if (g_str_equal(argv[1], "lamps"))
        conformance_lamps(&program_lamps_driver, &with);
    else if (g_str_equal(argv[1], "axis"))
        conformance_axis(&program_axis_driver, &with);
    else
        conformance_camera(&program_camera_driver, &with);
    return g_test_run();
}
