#include "lamps.h"

#include "base/options.h"

#include <math.h>
#include <string.h>

/* Default standard deviations of sizes. The value for posts is larger, because posts are cut and
 * set by hand, while balls are made for bearings. */
#define POST_MM 0.02
#define BALL_MM 0.005

struct fields {
    int kind; /* enum lamp_target_kind */
    double plane_mm, radius_mm, tolerance_mm;
    struct option_doubles plate_mm, places_mm;
};

#define FIELD(member) G_STRUCT_OFFSET(struct fields, member)
static const char *const kinds[] = {"poles", "balls", NULL};
static const struct option fields[] = {
    {"kind", OPTION_CHOICE, .choices = kinds, .offset = FIELD(kind), .help = "poles or balls"},
    {"plane_mm", OPTION_DOUBLE, "mm", 0, 1000, .offset = FIELD(plane_mm),
     .help = "height of the top of the plate above the turntable, 0 without a plate"},
    {"plate_mm", OPTION_DOUBLES, "mm", 1, 1000, .fallback = "", .offset = FIELD(plate_mm),
     .help = "width; height of the plate of posts"},
    {"radius_mm", OPTION_DOUBLE, "mm", 0, 1000, .fallback = "0", .offset = FIELD(radius_mm),
     .help = "radius of the posts"},
    {"places_mm", OPTION_DOUBLES, "mm", -1000, 1000, .offset = FIELD(places_mm),
     .help = "x; y; height of each post, or x; y; radius of each ball"},
    {"tolerance_mm", OPTION_DOUBLE, "mm", 0, 1000, .fallback = "0", .offset = FIELD(tolerance_mm),
     .help = "standard deviation of the sizes"},
    {NULL},
};

static void check_marks(const struct config_section *section, const struct option_doubles *places,
                        struct lamp_target *target, Mistakes *mistakes) {
    const char *key = "places_mm";
    target->n = MIN(places->n / 3, LAMP_MAX_MARKS);
    if (places->n == 0 || places->n % 3 != 0 || places->n / 3 > LAMP_MAX_MARKS) {
        config_mistake(mistakes, CONFIG_ERROR_VALUE, section, key,
                       "%d numbers are given: give x; y; height of each post or x; y; radius of "
                       "each ball, for 1 to %d posts or balls",
                       places->n, LAMP_MAX_MARKS);
        return;
    }
    for (int i = 0; i < target->n; i++) {
        const double *p = &places->values[3 * i];
        target->marks[i] = (struct lamp_mark){p[0], p[1], p[2]};
        if (!(p[2] > 0.1))
            config_mistake(mistakes, CONFIG_ERROR_VALUE, section, key,
                           "the height or radius of post or ball %d is %g mm, and must be above "
                           "0.1; give millimetres",
                           i + 1, p[2]);
        for (int j = 0; j < i; j++)
            if (hypot(p[0] - target->marks[j].x_mm, p[1] - target->marks[j].y_mm) < 0.1)
                config_mistake(mistakes, CONFIG_ERROR_VALUE, section, key,
                               "posts or balls %d and %d have the same position (within 0.1 mm); "
                               "correct one of them",
                               j + 1, i + 1);
    }
}

static void take_fields(const struct config_section *section, const struct fields *read,
                        struct lamp_target *target, Mistakes *mistakes) {
    target->kind = (enum lamp_target_kind)read->kind;
    target->plane_mm = read->plane_mm;
    target->radius_mm = read->radius_mm;
    target->tolerance_mm = config_value(section, "tolerance_mm", NULL) ? read->tolerance_mm
                           : target->kind == LAMP_BALLS                ? BALL_MM
                                                                       : POST_MM;
    check_marks(section, &read->places_mm, target, mistakes);
    if (target->plane_mm > 0 && target->plane_mm < 0.05)
        config_mistake(mistakes, CONFIG_ERROR_VALUE, section, "plane_mm",
                       "%g mm is too small for the height of a plate; give at least 0.05 mm, or 0 "
                       "if the posts or balls stand on the turntable itself",
                       target->plane_mm);
    if (target->kind == LAMP_BALLS)
        return;
    if (target->radius_mm < 0.05)
        config_mistake(mistakes, CONFIG_ERROR_VALUE, section, "radius_mm",
                       "%g mm is no radius of posts: give at least 0.05", target->radius_mm);
    if (read->plate_mm.n == 2)
        memcpy(target->plate_mm, read->plate_mm.values, sizeof target->plate_mm);
    else
        config_mistake(mistakes, CONFIG_ERROR_VALUE, section, "plate_mm",
                       "%d numbers are given: give two, the size of the plate along x and along y",
                       read->plate_mm.n);
}

gboolean lamp_target_load(struct lamp_target *target, const char *path, GError **error) {
    g_autoptr(Mistakes) mistakes = mistakes_new();
    g_autoptr(Config) config = config_load_checked(path, mistakes);
    const struct config_section *section = config ? config_find(config, "target", NULL) : NULL;
    struct fields read = {0};
    memset(target, 0, sizeof *target);
    if (config && !section && config_has_all_sections(config))
        config_lacks(mistakes, config,
                     "the file has no section [target]; see poles.conf and balls.conf in "
                     "/usr/share/mesorig/demo");
    if (section && options_read(&(struct option_target){fields, &read}, 1, section, NULL, mistakes))
        take_fields(section, &read, target, mistakes);
    options_clear(fields, &read);
    return mistakes_report(mistakes, error);
}
