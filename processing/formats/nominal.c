#include "nominal.h"

#include <math.h>
#include <string.h>

#include "base/config.h"
#include "base/data_error.h"
#include "base/input_file.h"
#include "base/nearest.h"
#include "import_private.h"
#include "poses_table.h"

#define LARGEST_MM 1e6
#define UNFILLED   "?"
/* A camera looks straight down if the angle between its axis and the vertical is at most this. */
#define STEEP_DEG 1.0

struct nominal_place {
    double width, height, focal_px, cx_px, cy_px, k1, k2, k3, p1, p2, vignetting, response,
        turn_deg, full_well_e, read_noise_e;
    double eye_mm[3], target_mm[3], position_mm[3], aim_mm[3], axis[3], intensity, exponent;
};

struct nominal_key {
    const char *name;
    gsize offset;
    int n; /* number of numbers in the value */
    double min, max;
    const char *otherwise; /* text of the default value; NULL means that the key is required */
    const char *help;
};

#define PLACE(member) G_STRUCT_OFFSET(struct nominal_place, member)
#define POINT(member) PLACE(member), 3, -LARGEST_MM, LARGEST_MM
static const struct nominal_key camera_keys[] = {
    {"width", PLACE(width), 1, 1, 65536, NULL, "width of a picture in pixels"},
    {"height", PLACE(height), 1, 1, 65536, NULL, "height of a picture in pixels"},
    {"focal_px", PLACE(focal_px), 1, 1e-3, 1e9, NULL,
     "focal length in pixels: focal length / width of a pixel"},
    {"eye_mm", POINT(eye_mm), NULL,
     "position of the lens: x; y; z from the middle of the turntable"},
    {"target_mm", POINT(target_mm), "0; 0; 0", "the point that is in the middle of the picture"},
    {"turn_deg", PLACE(turn_deg), 1, -360, 360, "0",
     "rotation of the camera about its line of sight, clockwise from behind; 0: the picture is "
     "level, or, for a camera that looks straight down, x points to its right and y to its top"},
    {"response", PLACE(response), 1, RIG_MIN_RESPONSE, RIG_MAX_RESPONSE,
     G_STRINGIFY(NOMINAL_RESPONSE),
     "4095 × share of white per second and W/(sr m²); calibrate radiometry measures it"},
    {"full_well_e", PLACE(full_well_e), 1, 1, 1e9, "nan",
     "electrons of a white pixel, from the data sheet; values then have error bars"},
    {"read_noise_e", PLACE(read_noise_e), 1, 0, 1e6, "0",
     "electrons of the noise without light, from the data sheet"},
    {"vignetting", PLACE(vignetting), 1, -1, 1, "0",
     "relative decrease of brightness in the corners"},
    {"cx_px", PLACE(cx_px), 1, -1e9, 1e9, "nan", "principal point in x; the middle if empty"},
    {"cy_px", PLACE(cy_px), 1, -1e9, 1e9, "nan", ""},
    {"k1", PLACE(k1), 1, -1e9, 1e9, "0", "distortion coefficient of OpenCV"},
    {"k2", PLACE(k2), 1, -1e9, 1e9, "0", ""},
    {"k3", PLACE(k3), 1, -1e9, 1e9, "0", ""},
    {"p1", PLACE(p1), 1, -1e9, 1e9, "0", ""},
    {"p2", PLACE(p2), 1, -1e9, 1e9, "0", ""},
    {NULL},
};
static const struct nominal_key lamp_keys[] = {
    {"position_mm", POINT(position_mm), NULL, "position at arc_deg = 0: x; y; z"},
    {"aim_mm", POINT(aim_mm), "0; 0; 0", "the point to which it is aimed"},
    {"intensity", PLACE(intensity), 1, 1e-12, RIG_MAX_INTENSITY, "1",
     "W/sr in the direction of its aim"},
    {"exponent", PLACE(exponent), 1, 0, 1e6, "0",
     "n of its fall-off cos^n away from the aim; 0: the same in all directions"},
    {NULL},
};
static const struct nominal_key laser_keys[] = {
    {"position_mm", POINT(position_mm), NULL, "position of the origin of its sheet at arc_deg = 0"},
    {"axis", PLACE(axis), 3, -1e6, 1e6, NULL,
     "axis of rotation of the sheet; at sweep_deg = 0 the sheet goes through 0; 0; 0"},
    {NULL},
};

static const struct nominal_kind {
    const char *class_name;
    const struct nominal_key *keys;
    int most;
} kinds[] = {{"camera", camera_keys, RIG_MAX_CAMERAS},
             {"lamp", lamp_keys, RIG_MAX_LAMPS},
             {"laser", laser_keys, RIG_MAX_LASERS}};

static gboolean numbers(const struct config_section *section, const struct nominal_key *key,
                        struct nominal_place *place, GError **error) {
    const char *given = config_value(section, key->name, NULL);
    double *to = (double *)((char *)place + key->offset);
    const char *text = given ? given : key->otherwise;
    if (!text)
        return config_set_error(error, CONFIG_ERROR_MISSING, section, key->name,
                                "a value is missing: %s", key->help);
    g_auto(GStrv) words = g_strsplit(text, ";", -1);
    gboolean good = (int)g_strv_length(words) == key->n;
    for (int i = 0; good && i < key->n; i++) {
        char *end;
        to[i] = g_ascii_strtod(g_strstrip(words[i]), &end);
        good = end != words[i] && !*end && (!given || isfinite(to[i]));
        if (good && (to[i] < key->min || to[i] > key->max))
            return config_set_error(error, CONFIG_ERROR_VALUE, section, key->name,
                                    "%g is out of range: %g to %g", to[i], key->min, key->max);
    }
    return good || config_set_error(error, CONFIG_ERROR_VALUE, section, key->name,
                                    key->n == 1 ? "“%s” is not a number"
                                                : "“%s” is not three numbers x; y; z",
                                    text);
}

static struct vec3 nominal_vec3(const double *p) {
    return vec3(p[0], p[1], p[2]);
}

gboolean nominal_looks_down(const struct rig_camera *camera) {
    return camera->rotation.m[2][2] < -cos(STEEP_DEG * G_PI / 180);
}

static gboolean nominal_camera(const struct config_section *section, const struct nominal_place *p,
                               struct rig *rig, GError **error) {
    struct rig_camera *camera = &rig->cameras[rig->n_cameras++];
    const struct vec3 eye = nominal_vec3(p->eye_mm), target = nominal_vec3(p->target_mm);
    if (p->width != floor(p->width) || p->height != floor(p->height))
        return config_set_error(error, CONFIG_ERROR_VALUE, section, "width",
                                "a picture cannot have %g × %g pixels; give whole numbers",
                                p->width, p->height);
    if (!(vec3_length(vec3_sub(eye, target)) > 1))
        return config_set_error(
            error, CONFIG_ERROR_VALUE, section, "eye_mm",
            "the point is less than 1 mm from target_mm; give two points that are farther apart");
    *camera = (struct rig_camera){.width = (int)p->width,
                                  .height = (int)p->height,
                                  .fx_px = p->focal_px,
                                  .fy_px = p->focal_px,
                                  .cx_px = isfinite(p->cx_px) ? p->cx_px : 0.5 * (p->width - 1),
                                  .cy_px = isfinite(p->cy_px) ? p->cy_px : 0.5 * (p->height - 1),
                                  .k1 = p->k1,
                                  .k2 = p->k2,
                                  .k3 = p->k3,
                                  .p1 = p->p1,
                                  .p2 = p->p2,
                                  .vignetting = p->vignetting,
                                  .response = p->response};
    g_strlcpy(camera->name, section->name, RIG_NAME);
    rig_camera_look_at(camera, eye, target);
    /* A picture without a horizon is oriented like a map: x points to the right, y to the top. */
    if (nominal_looks_down(camera)) {
        const struct vec3 forward = vec3_unit(vec3_sub(target, eye));
        const struct vec3 right = vec3_unit(
            vec3_sub(vec3(1, 0, 0), vec3_scale(forward, vec3_dot(vec3(1, 0, 0), forward))));
        const struct vec3 down = vec3_cross(forward, right);
        camera->rotation = (struct mat3){{{right.x, right.y, right.z},
                                          {down.x, down.y, down.z},
                                          {forward.x, forward.y, forward.z}}};
    }
    /* Turns the camera clockwise, seen from behind: its right axis turns towards its down axis. */
    const double c = cos(p->turn_deg * G_PI / 180), s = sin(p->turn_deg * G_PI / 180);
    const struct mat3 level = camera->rotation;
    for (int i = 0; i < 3; i++) {
        camera->rotation.m[0][i] = c * level.m[0][i] + s * level.m[1][i];
        camera->rotation.m[1][i] = c * level.m[1][i] - s * level.m[0][i];
    }
    camera->translation_mm = vec3_scale(mat3_mul_vec(&camera->rotation, eye), -1);
    return TRUE;
}

static gboolean nominal_lamp(const struct config_section *section, const struct nominal_place *p,
                             struct rig *rig, GError **error) {
    struct rig_lamp *lamp = &rig->lamps[rig->n_lamps++];
    const struct vec3 way = vec3_sub(nominal_vec3(p->aim_mm), nominal_vec3(p->position_mm));
    if (!(vec3_length(way) > 1))
        return config_set_error(
            error, CONFIG_ERROR_VALUE, section, "position_mm",
            "the point is less than 1 mm from aim_mm; give two points that are farther apart");
    *lamp = (struct rig_lamp){.position_mm = nominal_vec3(p->position_mm),
                              .aim = vec3_unit(way),
                              .exponent = p->exponent,
                              .intensity = p->intensity};
    g_strlcpy(lamp->name, section->name, RIG_NAME);
    return TRUE;
}

/* Adds a laser. Its sheet contains the axis, which goes through position_mm. At sweep_deg = 0 the
 * sheet also contains the origin, and its normal is position_mm × axis. */
static gboolean nominal_laser(const struct config_section *section, const struct nominal_place *p,
                              struct rig *rig, GError **error) {
    struct rig_laser *laser = &rig->lasers[rig->n_lasers++];
    const struct vec3 position = nominal_vec3(p->position_mm), axis = nominal_vec3(p->axis);
    const struct vec3 normal = vec3_cross(position, axis);
    if (!(vec3_length(axis) > 0))
        return config_set_error(
            error, CONFIG_ERROR_VALUE, section, "axis",
            "0; 0; 0 has no direction; give a vector along the axis of rotation");
    if (!(vec3_length(position) > 0))
        return config_set_error(
            error, CONFIG_ERROR_VALUE, section, "position_mm",
            "0; 0; 0 is the middle of the turntable; give the position of the laser");
    if (!(vec3_length(normal) > 1e-6 * vec3_length(position) * vec3_length(axis)))
        return config_set_error(error, CONFIG_ERROR_VALUE, section, "axis",
                                "%g; %g; %g points along the line from position_mm to the middle "
                                "of the turntable; give the axis about which the sheet turns",
                                axis.x, axis.y, axis.z);
    *laser = (struct rig_laser){
        .position_mm = position, .axis = vec3_unit(axis), .normal = vec3_unit(normal)};
    g_strlcpy(laser->name, section->name, RIG_NAME);
    return TRUE;
}

static gboolean nominal_section(const struct config_section *section,
                                const struct nominal_kind *kind, struct calibration *to,
                                GError **error) {
    struct rig *rig = &to->rig;
    const int counts[] = {rig->n_cameras, rig->n_lamps, rig->n_lasers};
    struct nominal_place place = {0};
    if (!section->name || strlen(section->name) >= RIG_NAME)
        return config_set_error(error, CONFIG_ERROR_VALUE, section, NULL,
                                "the section needs a name of 1 to %d bytes: [%s NAME]",
                                RIG_NAME - 1, kind->class_name);
    if (counts[kind - kinds] >= kind->most)
        return config_set_error(error, CONFIG_ERROR_VALUE, section, NULL,
                                "there are more than %d sections [%s NAME]; leave out the others",
                                kind->most, kind->class_name);
    for (const char *const *name = config_keys(section); *name; name++) {
        const struct nominal_key *key = kind->keys;
        while (key->name && strcmp(key->name, *name) != 0)
            key++;
        if (!key->name) {
            struct nearest nearest = nearest_new(*name);
            for (key = kind->keys; key->name; key++)
                nearest_consider(&nearest, key->name);
            if (nearest.name)
                return config_set_error(error, CONFIG_ERROR_UNKNOWN, section, *name,
                                        "there is no such key; did you mean %s?", nearest.name);
            return config_set_error(
                error, CONFIG_ERROR_UNKNOWN, section, *name,
                "a %s has no such key; “mesorig import poses --template” writes all keys",
                kind->class_name);
        }
    }
    for (const struct nominal_key *key = kind->keys; key->name; key++)
        if (!numbers(section, key, &place, error))
            return FALSE;
    if (kind->keys == camera_keys) {
        if (!nominal_camera(section, &place, rig, error))
            return FALSE;
        /* The gain in DN per electron follows from the full well, with white at 4095 DN. */
        if (isfinite(place.full_well_e))
            to->noise[rig->n_cameras - 1] = (struct calibration_noise){
                .known = TRUE,
                .transfer = {.gain_dn_e = IMPORT_WHITE_DN / place.full_well_e,
                             .read_noise_e = place.read_noise_e}};
        return TRUE;
    }
    return kind->keys == lamp_keys ? nominal_lamp(section, &place, rig, error)
                                   : nominal_laser(section, &place, rig, error);
}

static struct calibration *from_config(const Config *config, GError **error) {
    const struct rig rig = {.id = "nominal"};
    g_autoptr(Calibration) ret = calibration_new(&rig);
    gsize n;
    const struct config_section *sections = config_sections(config, &n);
    for (gsize i = 0; i < n; i++) {
        const struct config_section *section = &sections[i];
        const struct nominal_kind *kind = NULL;
        for (gsize k = 0; k < G_N_ELEMENTS(kinds); k++)
            if (strcmp(section->class_name, kinds[k].class_name) == 0)
                kind = &kinds[k];
        const gboolean is_rig = strcmp(section->class_name, "rig") == 0;
        const char *id = is_rig ? config_value(section, "id", NULL) : NULL;
        if (is_rig && !id) {
            config_set_error(error, CONFIG_ERROR_VALUE, section, "id",
                             "the rig has no id; add a line “id = NAME”");
            return NULL;
        }
        if (!kind && !is_rig) {
            config_set_error(error, CONFIG_ERROR_UNKNOWN, section, NULL,
                             "this section is not known; use [rig] with its id, [camera NAME], "
                             "[lamp NAME] and [laser NAME]");
            return NULL;
        }
        if (is_rig)
            g_strlcpy(ret->rig.id, id, sizeof ret->rig.id);
        else if (!nominal_section(section, kind, ret, error))
            return NULL;
    }
    return g_steal_pointer(&ret);
}

struct calibration *nominal_read(const char *path, GError **error) {
    g_autoptr(GKeyFile) file = g_key_file_new();
    g_autofree char *text = input_file_read_text(path, 1 << 20, NULL);
    /* A calibration file has the key “format”. For a file that is neither a calibration nor nominal
     * values, calibration_read() gives the error. */
    if (!text || !g_key_file_load_from_data(file, text, strlen(text), G_KEY_FILE_NONE, NULL) ||
        g_key_file_has_key(file, "rig", "format", NULL) || !strstr(text, "[camera "))
        return calibration_read(path, error);
    g_autoptr(Config) config = config_parse(text, path, error);
    return config ? from_config(config, error) : NULL;
}

/* Returns the value of a key if a picture of the camera tells the value, otherwise NULL. *ret_said
 * gets a text that says where the value is from, or NULL. Free both with g_free(). */
static char *value_of(const struct nominal_key *key, const struct import_picture *picture,
                      const struct picture_says *says, char **ret_said) {
    if (key->offset == PLACE(width) || key->offset == PLACE(height))
        return g_strdup_printf("%d",
                               key->offset == PLACE(width) ? picture->width : picture->height);
    if (key->offset != PLACE(focal_px))
        return NULL;
    const double focal_px = picture_says_focal_px(says, picture->width, picture->height, ret_said);
    return focal_px > 0 ? g_strdup_printf("%.1f", focal_px) : NULL;
}

/* Appends a section with all keys of a device. A key has its default value, or UNFILLED if it is
 * required. picture is a picture of the camera, or NULL for lamps and lasers. */
static void append(GString *text, const struct nominal_kind *kind, const char *name,
                   const struct import_picture *picture, const struct picture_says *says) {
    g_string_append_printf(text, "\n[%s %s]\n", kind->class_name, name);
    for (const struct nominal_key *key = kind->keys; key->name; key++) {
        g_autofree char *said = NULL;
        g_autofree char *found = picture ? value_of(key, picture, says, &said) : NULL;
        const char *value = found ? found : key->otherwise ? key->otherwise : UNFILLED;
        if (*key->help)
            g_string_append_printf(text, "# %s\n", key->help);
        if (said)
            g_string_append_printf(text,
                                   "# CHECK: from the picture (%s). A lens that is focused on a "
                                   "near object may be several per cent off\n",
                                   said);
        if (strcmp(value, "nan") == 0)
            g_string_append_printf(text, "# %s =\n", key->name);
        else
            g_string_append_printf(text, "%s = %s\n", key->name, value);
    }
}

char *nominal_template(const char *path, GError **error) {
    g_autoptr(TextTable) table = poses_table_read(path, error);
    g_autoptr(GHashTable) known = g_hash_table_new_full(g_str_hash, g_str_equal, g_free, NULL);
    g_autofree char *absolute = g_canonicalize_filename(path, NULL);
    g_autofree char *folder = g_path_get_dirname(absolute);
    if (!table)
        return NULL;
    GString *text = g_string_new("# Replace each ? by a value. Points are x; y; z in mm, from the "
                                 "middle of the turntable's top, z up.\n[rig]\nid = nominal\n");
    for (gsize k = 0; k < G_N_ELEMENTS(kinds); k++)
        for (int i = 0; i < text_table_rows(table); i++) {
            const char *name =
                text_table_text(table, i, text_table_column(table, kinds[k].class_name));
            g_autofree char *key = g_strdup_printf("%s %s", kinds[k].class_name, name);
            g_autoptr(ImportPicture) picture = NULL;
            g_autoptr(GError) found = NULL;
            struct picture_says says = {0};
            if (!*name || !g_hash_table_add(known, g_steal_pointer(&key)))
                continue;
            if (k == 0) {
                g_autofree char *file = g_canonicalize_filename(
                    text_table_text(table, i, text_table_column(table, "file")), folder);
                picture = import_picture_read_codes(file, &found);
                picture_says_read_file(file, &says);
                picture_says_clear(&says); /* frees the tone curve; the numbers remain */
            }
            if (found) {
                data_error_set(path, text_table_line(table, i), error, "%s", found->message);
                g_string_free(text, TRUE);
                return NULL;
            }
            append(text, &kinds[k], name, picture, &says);
        }
    return g_string_free(text, FALSE);
}
