#include "lamp_places.h"

#include "base/data_error.h"
#include "base/input_file.h"
#include "base/text_table.h"

#include <math.h>
#include <string.h>

#define DEG       (180 / G_PI)
#define MAX_BYTES (1024 * 1024)
/* Limits of a place, as in [lamp NAME]. */
#define MAX_THETA_DEG   89.9
#define MIN_DISTANCE_MM 1.0
#define MAX_DISTANCE_MM 1e5
/* x y z of at most this length is refused as a position in millimetres, because it is probably a
 * unit vector. */
#define UNIT_LENGTH 1.5
/* Consecutive azimuths of the spiral differ by this angle, the golden angle π (3 − √5). */
#define GOLDEN_DEG 137.50776405003785

static const char *const place_keys[] = {"count", "rings", "theta_deg", "positions", NULL};

const char *lamp_places_key(const struct config_section *section) {
    if (!g_str_equal(section->class_name, "lamps"))
        return NULL;
    for (const char *const *key = place_keys; *key; key++)
        if (config_value(section, *key, NULL))
            return *key;
    return NULL;
}

/* Returns the angle in (−360, 360) that is the same azimuth. */
static double azimuth(double phi_deg) {
    return fmod(phi_deg, 360);
}

/* Adds a lamp. The name and the index are set later. */
static void add(GArray *lamps, const struct bank_fields *fields, double theta_deg, double phi_deg) {
    const struct lamp_place lamp = {.index = -1,
                                    .theta_deg = theta_deg,
                                    .phi_deg = azimuth(fields->phi_deg + phi_deg),
                                    .distance_mm = fields->distance_mm,
                                    .exponent = fields->exponent,
                                    .intensity = fields->intensity};
    g_array_append_val(lamps, lamp);
}

/* Adds a spiral of n lamps over the zone between θ₀ = theta_from_deg and θ₁ = theta_to_deg. Each
 * lamp has an equal part of the area of the zone. For lamp i, counted from 0, cos θ = cos θ₀ − (i +
 * ½)/n (cos θ₀ − cos θ₁), and φ is i times the golden angle. */
static gboolean add_spiral(GArray *lamps, const struct bank_fields *fields,
                           const struct config_section *section, Mistakes *mistakes) {
    const double top = cos(fields->theta_from_deg / DEG), rim = cos(fields->theta_to_deg / DEG);
    if (fields->count < 1)
        return config_mistake(mistakes, CONFIG_ERROR_VALUE, section, "count",
                              "is 0; give 1 to %d lamps", RIG_MAX_LAMPS);
    if (fields->theta_from_deg >= fields->theta_to_deg)
        return config_mistake(mistakes, CONFIG_ERROR_VALUE, section, "theta_from_deg",
                              "is %g, but must be less than theta_to_deg, which is %g",
                              fields->theta_from_deg, fields->theta_to_deg);
    for (int i = 0; i < fields->count; i++)
        add(lamps, fields, acos(top - (i + 0.5) / fields->count * (top - rim)) * DEG,
            i * GOLDEN_DEG);
    return TRUE;
}

static gboolean number_between(const char *text, double min, double max, double *ret) {
    return text_table_parse(text, FALSE, ret) && *ret >= min && *ret <= max;
}

/* Adds a ring "theta:count" or "theta:count:offset". */
static gboolean add_ring(GArray *lamps, const struct bank_fields *fields, const char *text) {
    g_auto(GStrv) words = g_strsplit(text, ":", 4);
    const guint n = g_strv_length(words);
    double theta_deg, count, offset_deg = 0;

    for (guint i = 0; i < n; i++)
        g_strstrip(words[i]);
    if (n < 2 || n > 3 || !number_between(words[0], 0, MAX_THETA_DEG, &theta_deg) ||
        !number_between(words[1], 1, RIG_MAX_LAMPS, &count) || count != floor(count) ||
        (n == 3 && !number_between(words[2], -360, 360, &offset_deg)) ||
        (theta_deg == 0 && count > 1))
        return FALSE;
    for (int i = 0; i < count; i++)
        add(lamps, fields, theta_deg, offset_deg + i * 360 / count);
    return TRUE;
}

static gboolean add_rings(GArray *lamps, const struct bank_fields *fields,
                          const struct config_section *section, Mistakes *mistakes) {
    for (char **ring = fields->rings; *ring; ring++)
        if (!add_ring(lamps, fields, *ring))
            return config_mistake(
                mistakes, CONFIG_ERROR_VALUE, section, "rings",
                "\"%s\" is not theta:count or theta:count:offset with theta from 0 to %g degrees, "
                "count from 1 to %d (1 at theta 0), offset from -360 to 360",
                *ring, MAX_THETA_DEG, RIG_MAX_LAMPS);
        else if (lamps->len > RIG_MAX_LAMPS)
            break; /* the caller reports it */
    return TRUE;
}

/* Sets the place of a lamp from a vector from the middle of the turntable's top. If distance_mm is
 * 0, the length of the vector is the distance of the lamp. Returns FALSE with an error if a lamp
 * cannot stand there. */
static gboolean set_vector(struct lamp_place *lamp, const double v[3], double distance_mm,
                           const char *path, int line, GError **error) {
    const double level = hypot(v[0], v[1]), length = hypot(level, v[2]);

    lamp->theta_deg = atan2(level, v[2]) * DEG;
    lamp->phi_deg = atan2(v[1], v[0]) * DEG;
    lamp->distance_mm = distance_mm > 0 ? distance_mm : length;
    if (!(length > 0) || lamp->theta_deg > MAX_THETA_DEG)
        return data_error_fail(
            path, line, error,
            "%g %g %g is not above the turntable's top, or has a theta of more than "
            "%g°; z points upwards; give a larger z",
            v[0], v[1], v[2], MAX_THETA_DEG);
    if (distance_mm == 0 && length <= UNIT_LENGTH)
        return data_error_fail(path, line, error,
                               "%g %g %g has the length %.3g; if these are directions, give "
                               "distance_mm in the section of the bank, otherwise write "
                               "millimetres",
                               v[0], v[1], v[2], length);
    if (!(lamp->distance_mm <= MAX_DISTANCE_MM))
        return data_error_fail(path, line, error, "%g %g %g is farther away than %g mm; correct it",
                               v[0], v[1], v[2], MAX_DISTANCE_MM);
    return TRUE;
}

static gboolean check_number(const GArray *lamps, const char *path, int line, GError **error) {
    return lamps->len < RIG_MAX_LAMPS ||
           data_error_fail(path, line, error,
                           "there are more than %d lamps, which is the maximum; remove this one "
                           "and those after it",
                           RIG_MAX_LAMPS);
}

/* Reads a line "NAME x y z". The name may contain blanks. */
static gboolean read_light(GArray *lamps, const struct lamp_place *otherwise, char *text,
                           const char *path, int line, GError **error) {
    struct lamp_place lamp = *otherwise;
    double v[3];

    g_strdelimit(text, "\t", ' ');
    for (int i = 2; i >= 0; i--) {
        char *blank = strrchr(g_strchomp(text), ' ');
        const char *word = blank ? blank + 1 : text;
        if (!blank || !text_table_parse(word, TRUE, &v[i]))
            return data_error_fail(path, line, error,
                                   blank ? "“%s” is not a number; a picture's name and x y z are "
                                           "expected"
                                         : "“%s” stands where a picture's name and x y z are "
                                           "expected",
                                   word);
        *blank = '\0';
    }
    if (!check_number(lamps, path, line, error) ||
        !set_vector(&lamp, v, otherwise->distance_mm, path, line, error))
        return FALSE;
    g_array_append_val(lamps, lamp);
    return TRUE;
}

static gboolean read_list(GArray *lamps, const struct lamp_place *otherwise, const char *text,
                          const char *path, GError **error) {
    g_auto(GStrv) lines = text_table_lines(text);
    int count_line = 0;
    double count = 0;

    for (int i = 0; lines[i]; i++) {
        char *line = g_strstrip(lines[i]);
        if (!*line || *line == '#')
            continue;
        if (count_line == 0) {
            count_line = i + 1;
            if (!number_between(line, 1, RIG_MAX_LAMPS, &count) || count != floor(count))
                return data_error_fail(path, i + 1, error,
                                       "“%s” is not the number of lights, 1 to %d, which a list "
                                       "begins with",
                                       line, RIG_MAX_LAMPS);
        } else if (!read_light(lamps, otherwise, line, path, i + 1, error)) {
            return FALSE;
        }
    }
    if (count_line == 0)
        return data_error_fail(path, 1, error,
                               "the list is empty; begin it with the number of lights");
    return lamps->len == count ||
           data_error_fail(path, count_line, error,
                           "this line states %g lights, but the file lists %u; correct the number, "
                           "or list every light",
                           count, lamps->len);
}

/* Indices of the columns of a table, −1 if there is no such column. */
struct columns {
    int name, bank, index, v[3], theta, phi, distance, exponent, intensity;
};

static gboolean find_columns(const TextTable *table, double distance_mm, struct columns *ret,
                             GError **error) {
    static const char *const known[] = {"name",        "bank",     "index",     "x_mm",
                                        "y_mm",        "z_mm",     "theta_deg", "phi_deg",
                                        "distance_mm", "exponent", "intensity", NULL};
    *ret =
        (struct columns){.name = text_table_column(table, "name"),
                         .bank = text_table_column(table, "bank"),
                         .index = text_table_column(table, "index"),
                         .v = {text_table_column(table, "x_mm"), text_table_column(table, "y_mm"),
                               text_table_column(table, "z_mm")},
                         .theta = text_table_column(table, "theta_deg"),
                         .phi = text_table_column(table, "phi_deg"),
                         .distance = text_table_column(table, "distance_mm"),
                         .exponent = text_table_column(table, "exponent"),
                         .intensity = text_table_column(table, "intensity")};
    if (!text_table_check_columns(table, known, error))
        return FALSE;
    const gboolean point = ret->v[0] >= 0 && ret->v[1] >= 0 && ret->v[2] >= 0;
    const gboolean any_point = ret->v[0] >= 0 || ret->v[1] >= 0 || ret->v[2] >= 0;
    const gboolean angles = ret->theta >= 0 && ret->phi >= 0;
    const gboolean any_angle = ret->theta >= 0 || ret->phi >= 0 || ret->distance >= 0;
    if (!(point && !any_angle) && !(angles && !any_point))
        return data_error_fail(
            text_table_path(table), 0, error,
            "the table must have the columns x_mm, y_mm and z_mm, or theta_deg, phi_deg and "
            "distance_mm, and not columns of both kinds");
    return point || ret->distance >= 0 || distance_mm > 0 ||
           data_error_fail(text_table_path(table), 0, error,
                           "the table has no column distance_mm; add it, or give distance_mm in "
                           "the section of the bank");
}

static gboolean within(const TextTable *table, int row, const char *name, double value, double min,
                       double max, GError **error) {
    return (value >= min && value <= max) ||
           data_error_fail(text_table_path(table), text_table_line(table, row), error,
                           "%s: %g is out of range: %g to %g", name, value, min, max);
}

static gboolean take_name(const TextTable *table, int row, int column, const char *key,
                          char ret[RIG_NAME], GError **error) {
    const char *name = text_table_text(table, row, column);
    gboolean good =
        strlen(name) < RIG_NAME && g_utf8_validate(name, -1, NULL) && !strpbrk(name, "[];@");
    for (const char *c = name; *c; c++)
        good &= !g_ascii_iscntrl(*c);
    g_strlcpy(ret, good ? name : "", RIG_NAME);
    return good || data_error_fail(text_table_path(table), text_table_line(table, row), error,
                                   "%s: “%s” is not a name: give at most %d bytes of UTF-8, "
                                   "without [ ] ; @ and control characters",
                                   key, name, RIG_NAME - 1);
}

static gboolean read_row(GArray *lamps, const struct lamp_place *otherwise, const TextTable *table,
                         const struct columns *c, int row, GError **error) {
    const char *path = text_table_path(table);
    const int line = text_table_line(table, row);
    struct lamp_place lamp = *otherwise;
    double v[3] = {0}, index;

    if (!check_number(lamps, path, line, error) ||
        !take_name(table, row, c->name, "name", lamp.name, error) ||
        !take_name(table, row, c->bank, "bank", lamp.bank, error) ||
        !text_table_number(table, row, c->index, -1, &index, error) ||
        !text_table_number(table, row, c->exponent, lamp.exponent, &lamp.exponent, error) ||
        !text_table_number(table, row, c->intensity, lamp.intensity, &lamp.intensity, error) ||
        !within(table, row, "exponent", lamp.exponent, 0, 1000, error) ||
        !within(table, row, "intensity", lamp.intensity, 1e-6, RIG_MAX_INTENSITY, error))
        return FALSE;
    if (c->index >= 0 && !(index >= 0 && index <= 1023 && index == floor(index)))
        return data_error_fail(path, line, error,
                               "index: “%s” is not a whole number from 0 to 1023",
                               text_table_text(table, row, c->index));
    if (c->bank >= 0 && !*lamp.bank)
        return data_error_fail(path, line, error, "bank: is empty; name the bank of the lamp");
    lamp.index = (int)index;
    lamp.line = line;
    for (int i = 0; i < 3; i++)
        if (!text_table_number(table, row, c->v[i], NAN, &v[i], error))
            return FALSE;
    if (c->v[0] >= 0) {
        if (isnan(v[0]) || isnan(v[1]) || isnan(v[2]))
            return data_error_fail(path, line, error, "%s is empty; give x_mm, y_mm and z_mm",
                                   isnan(v[0])   ? "x_mm"
                                   : isnan(v[1]) ? "y_mm"
                                                 : "z_mm");
        if (!set_vector(&lamp, v, 0, path, line, error))
            return FALSE;
    } else if (!text_table_number(table, row, c->theta, NAN, &lamp.theta_deg, error) ||
               !text_table_number(table, row, c->phi, NAN, &lamp.phi_deg, error) ||
               !text_table_number(table, row, c->distance, lamp.distance_mm, &lamp.distance_mm,
                                  error) ||
               !within(table, row, "theta_deg", lamp.theta_deg, 0, MAX_THETA_DEG, error) ||
               !within(table, row, "phi_deg", lamp.phi_deg, -360, 360, error) ||
               !within(table, row, "distance_mm", lamp.distance_mm, MIN_DISTANCE_MM,
                       MAX_DISTANCE_MM, error)) {
        return FALSE;
    }
    g_array_append_val(lamps, lamp);
    return TRUE;
}

static gboolean read_table(GArray *lamps, const struct lamp_place *otherwise, const char *path,
                           GError **error) {
    g_autoptr(TextTable) table = text_table_read(path, error);
    struct columns columns;

    if (!table || !find_columns(table, otherwise->distance_mm, &columns, error))
        return FALSE;
    for (int row = 0; row < text_table_rows(table); row++)
        if (!read_row(lamps, otherwise, table, &columns, row, error))
            return FALSE;
    return TRUE;
}

GArray *lamp_places_read(const char *path, const struct lamp_place *otherwise, GError **error) {
    g_autoptr(GArray) lamps = g_array_new(FALSE, TRUE, sizeof(struct lamp_place));
    gboolean ok;

    if (g_str_has_suffix(path, ".lp")) {
        GError *why = NULL;
        g_autofree char *text = input_file_read_text(path, MAX_BYTES, &why);
        if (!text)
            input_file_propagate(why, DATA_ERROR, DATA_ERROR_INVALID, DATA_ERROR_INVALID, error);
        ok = text && read_list(lamps, otherwise, text, path, error);
    } else {
        ok = read_table(lamps, otherwise, path, error);
    }
    return ok ? g_steal_pointer(&lamps) : NULL;
}

static gboolean add_file(GArray *lamps, const struct bank_fields *fields,
                         const struct config_section *section, Mistakes *mistakes) {
    const struct lamp_place otherwise = {.index = -1,
                                         .distance_mm = fields->distance_mm,
                                         .exponent = fields->exponent,
                                         .intensity = fields->intensity};
    g_autofree char *path = config_resolve(section->config, fields->positions);
    g_autoptr(GError) error = NULL;
    g_autoptr(GArray) read = lamp_places_read(path, &otherwise, &error);

    if (!read)
        return config_mistake(mistakes, CONFIG_ERROR_VALUE, section, "positions", "%s",
                              error->message);
    for (guint i = 0; i < read->len; i++) {
        struct lamp_place *lamp = &g_array_index(read, struct lamp_place, i);
        lamp->phi_deg = azimuth(lamp->phi_deg + fields->phi_deg);
        if (!*lamp->bank || g_str_equal(lamp->bank, section->name))
            g_array_append_val(lamps, *lamp);
        else if (config_has_all_sections(section->config) &&
                 !config_find(section->config, "lamps", lamp->bank))
            return config_mistake(mistakes, CONFIG_ERROR_MISSING, section, "positions",
                                  "%s:%d: bank: there is no section [lamps %s]; name an existing "
                                  "one",
                                  path, lamp->line, lamp->bank);
    }
    return TRUE;
}

/* Checks that the keys fit `key`, which says where the lamps are (NULL if none does). Only one key
 * may say this. Keys that belong to another way to place lamps must be missing, and distance_mm
 * must be given if it is needed. */
static gboolean check_keys(const struct bank_fields *fields, const struct config_section *section,
                           const char *key, Mistakes *mistakes) {
    static const char *const of_count[] = {"theta_from_deg", "theta_to_deg", NULL};
    static const char *const of_any[] = {"phi_deg",  "distance_mm", "first_index",
                                         "exponent", "intensity",   NULL};

    for (const char *const *other = place_keys; *other; other++)
        if (key && !g_str_equal(*other, key) && config_value(section, *other, NULL))
            return config_mistake(mistakes, CONFIG_ERROR_VALUE, section, *other,
                                  "says where the lamps are, as %s does; give one of the two", key);
    for (const char *const *only = of_count; *only; only++)
        if (g_strcmp0(key, "count") != 0 && config_value(section, *only, NULL))
            return config_mistake(mistakes, CONFIG_ERROR_VALUE, section, *only,
                                  "belongs to count, which is not given; remove it, or give count");
    for (const char *const *only = of_any; *only; only++)
        if (!key && config_value(section, *only, NULL))
            return config_mistake(mistakes, CONFIG_ERROR_MISSING, section, *only,
                                  "belongs to lamps that this section places; give count, rings, "
                                  "theta_deg or positions, or remove it");
    if (!key || fields->distance_mm >= MIN_DISTANCE_MM ||
        (g_str_equal(key, "positions") && fields->distance_mm == 0))
        return TRUE;
    return config_mistake(mistakes, CONFIG_ERROR_MISSING, section, "distance_mm",
                          "must be given, and must be from %g to %g mm", MIN_DISTANCE_MM,
                          MAX_DISTANCE_MM);
}

/* Gives names and indices to the lamps that have none. */
static gboolean number_lamps(GArray *lamps, const struct bank_fields *fields,
                             const struct config_section *section, Mistakes *mistakes) {
    const int digits = lamps->len > 99 ? 3 : 2;

    for (guint i = 0; i < lamps->len; i++) {
        struct lamp_place *lamp = &g_array_index(lamps, struct lamp_place, i);
        if (lamp->index < 0)
            lamp->index = fields->first_index + (int)i;
        if (*lamp->name)
            continue;
        if (g_snprintf(lamp->name, RIG_NAME, "%s_%0*u", section->name, digits, i + 1) >= RIG_NAME)
            return config_mistake(mistakes, CONFIG_ERROR_VALUE, section, NULL,
                                  "the names of its lamps would have more than %d bytes: give the "
                                  "section a shorter name",
                                  RIG_NAME - 1);
    }
    return TRUE;
}

GArray *lamp_places_new(const struct bank_fields *fields, const struct config_section *section,
                        Mistakes *mistakes) {
    const char *key = lamp_places_key(section);
    g_autoptr(GArray) lamps = g_array_new(FALSE, TRUE, sizeof(struct lamp_place));
    gboolean ok = check_keys(fields, section, key, mistakes);

    if (ok && g_strcmp0(key, "count") == 0)
        ok = add_spiral(lamps, fields, section, mistakes);
    if (ok && g_strcmp0(key, "rings") == 0)
        ok = add_rings(lamps, fields, section, mistakes);
    if (ok && g_strcmp0(key, "positions") == 0)
        ok = add_file(lamps, fields, section, mistakes);
    for (int i = 0; ok && i < fields->theta_deg.n; i++)
        add(lamps, fields, fields->theta_deg.values[i], 0);
    if (ok && key && (lamps->len == 0 || lamps->len > RIG_MAX_LAMPS))
        ok = config_mistake(mistakes, CONFIG_ERROR_VALUE, section, key,
                            lamps->len == 0 ? "names no lamp; give 1 to %d"
                                            : "names too many lamps; give 1 to %d",
                            RIG_MAX_LAMPS);
    return ok && number_lamps(lamps, fields, section, mistakes) ? g_steal_pointer(&lamps) : NULL;
}
