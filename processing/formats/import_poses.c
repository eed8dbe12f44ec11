/* Reads the table, sorts its rows into shots, compares the rows with each other and with the
 * calibration, and creates the session. */
#include "import_poses_private.h"

#include "base/data_error.h"
#include "btf/btf.h"
#include "nominal.h"
#include "poses_table.h"

#include <gio/gio.h>
#include <math.h>
#include <string.h>

/* number of steps in a degree; angles are rounded to steps before they are compared */
#define STEPS_A_DEG 10000
#define MAX_ROWS    1000000

static gint64 steps(double deg) {
    const gint64 turn = (gint64)360 * STEPS_A_DEG;
    const gint64 at = llround(remainder(deg, 360) * STEPS_A_DEG) % turn;
    return at < 0 ? at + turn : at;
}

/* Returns the index of the element whose field at name_at equals name, or −1. */
static int find_device(gconstpointer list, gsize size, gsize name_at, int n, const char *name) {
    for (int i = 0; i < n; i++)
        if (strcmp((const char *)list + (gsize)i * size + name_at, name) == 0)
            return i;
    return -1;
}
struct columns {
    int file, camera, lamp, laser, turntable, arc, exposure, sweep;
};

/* Reads the camera, and the lamp or the laser. */
static gboolean read_devices(const struct import_set *set, const TextTable *table,
                             const struct columns *columns, int index, struct import_row *row,
                             GError **error) {
    const struct rig *rig = &set->known->rig;
    const char *camera = text_table_text(table, index, columns->camera);
    const char *lamp = text_table_text(table, index, columns->lamp);
    const char *laser = text_table_text(table, index, columns->laser);
    row->sweep = *laser != '\0';
    row->camera = find_device(rig->cameras, sizeof *rig->cameras,
                              G_STRUCT_OFFSET(struct rig_camera, name), rig->n_cameras, camera);
    row->device = row->sweep
                      ? find_device(rig->lasers, sizeof *rig->lasers,
                                    G_STRUCT_OFFSET(struct rig_laser, name), rig->n_lasers, laser)
                      : find_device(rig->lamps, sizeof *rig->lamps,
                                    G_STRUCT_OFFSET(struct rig_lamp, name), rig->n_lamps, lamp);
    if (row->camera < 0)
        return data_error_fail(
            set->table, row->line, error,
            "camera “%s” is not in %s; correct the name, or add a section for this camera", camera,
            set->wish->calibration);
    if (*lamp != '\0' && row->sweep)
        return data_error_fail(set->table, row->line, error,
                               "there are a lamp and a laser; leave one of them empty");
    if (*lamp == '\0' && !row->sweep)
        return data_error_fail(set->table, row->line, error,
                               "lamp and laser are both empty; give one of them");
    if (row->device < 0)
        return data_error_fail(set->table, row->line, error,
                               "%s “%s” is not in %s; correct the name, or add its section",
                               row->sweep ? "laser" : "lamp", row->sweep ? laser : lamp,
                               set->wish->calibration);
    return TRUE;
}

static gboolean read_row(const struct import_set *set, const TextTable *table,
                         const struct columns *columns, int index, struct import_row *row,
                         GError **error) {
    g_autofree char *table_path = g_canonicalize_filename(set->table, NULL);
    g_autofree char *folder = g_path_get_dirname(table_path);
    row->line = text_table_line(table, index);
    row->name = text_table_text(table, index, columns->file);
    row->path = g_canonicalize_filename(row->name, folder);
    if (!text_table_number(table, index, columns->turntable, 0, &row->turntable_deg, error) ||
        !text_table_number(table, index, columns->arc, 0, &row->arc_deg, error) ||
        !text_table_number(table, index, columns->exposure, 1, &row->exposure_ms, error) ||
        !text_table_number(table, index, columns->sweep, NAN, &row->sweep_deg, error) ||
        !read_devices(set, table, columns, index, row, error) ||
        !import_coding_read(set, table, index, folder, row, error))
        return FALSE;
    if (!*row->name)
        return data_error_fail(set->table, row->line, error,
                               "the column file is empty; give a picture's name");
    if (!g_file_test(row->path, G_FILE_TEST_IS_REGULAR))
        return data_error_fail(set->table, row->line, error,
                               "there is no picture %s; correct its name in the column file, or "
                               "copy the picture there",
                               row->path);
    if (!(row->exposure_ms > 0))
        return data_error_fail(set->table, row->line, error,
                               "exposure_ms is %g; it must be above 0", row->exposure_ms);
    return !row->sweep || isfinite(row->sweep_deg) ||
           data_error_fail(
               set->table, row->line, error,
               "sweep_deg is empty, but a picture of a sweep needs the angle of its laser");
}

static void clear_row(gpointer data) {
    struct import_row *row = data;
    g_free(row->path);
    g_free(row->coding.flat_path);
    g_free(row->coding.dark_path);
}

static gboolean read_rows(struct import_set *set, const TextTable *table, GError **error) {
    const struct columns columns = {.file = text_table_column(table, "file"),
                                    .camera = text_table_column(table, "camera"),
                                    .lamp = text_table_column(table, "lamp"),
                                    .laser = text_table_column(table, "laser"),
                                    .turntable = text_table_column(table, "turntable_deg"),
                                    .arc = text_table_column(table, "arc_deg"),
                                    .exposure = text_table_column(table, "exposure_ms"),
                                    .sweep = text_table_column(table, "sweep_deg")};
    if (text_table_rows(table) > MAX_ROWS)
        return data_error_fail(
            set->table, 0, error,
            "the table has more than %d rows; import the pictures as several sessions", MAX_ROWS);
    for (int i = 0; i < text_table_rows(table); i++) {
        struct import_row row = {0};
        const gboolean ok = read_row(set, table, &columns, i, &row, error);
        g_array_append_val(set->rows, row);
        if (!ok)
            return FALSE;
    }
    return TRUE;
}

/* Compares the shots of two rows: sweep or lamp, turntable, arc, and device. Returns a number
 * below, equal to or above 0. */
static int compare_shots(const struct import_row *a, const struct import_row *b) {
    const gint64 keys[4][2] = {{a->sweep, b->sweep},
                               {steps(a->turntable_deg), steps(b->turntable_deg)},
                               {steps(a->arc_deg), steps(b->arc_deg)},
                               {a->device, b->device}};
    for (int i = 0; i < 4; i++)
        if (keys[i][0] != keys[i][1])
            return keys[i][0] < keys[i][1] ? -1 : 1;
    return 0;
}

static int compare_rows(gconstpointer x, gconstpointer y) {
    const struct import_row *a = x, *b = y;
    const int shots = compare_shots(a, b);
    if (shots != 0 || a->camera != b->camera)
        return shots != 0 ? shots : a->camera - b->camera;
    if (a->sweep && a->sweep_deg != b->sweep_deg)
        return a->sweep_deg < b->sweep_deg ? -1 : 1;
    return a->line - b->line;
}

static double radians(double deg) {
    return deg * G_PI / 180;
}

/* Returns the direction, in the sample frame, from the centre of the reference plane to a device.
 * at_mm is the position of the device in the rig frame. */
static struct vec3 import_poses_direction(const struct import_set *set, struct vec3 at_mm,
                                          double turntable_deg) {
    at_mm.z -= set->wish->grid.reference_mm;
    return vec3_unit(rig_turn(at_mm, -radians(turntable_deg)));
}

/* Returns the index of a view, light or laser position in the list. An entry fits if it has the
 * same device at the same angle. If within_deg is above 0, an entry also fits if its direction is
 * at most within_deg away. If no entry fits, appends a new one. */
static int direction_index(GArray *list, int device, double turntable_deg, struct vec3 direction,
                           double within_deg) {
    const double least = cos(radians(within_deg));
    double theta, phi;
    for (guint i = 0; i < list->len; i++) {
        const struct session_direction *known = &g_array_index(list, struct session_direction, i);
        if ((known->device == device && steps(known->turntable_deg) == steps(turntable_deg)) ||
            (within_deg > 0 &&
             vec3_dot(direction,
                      rig_direction(radians(known->theta_deg), radians(known->phi_deg))) >= least))
            return (int)i;
    }
    rig_angles(direction, &theta, &phi);
    const struct session_direction added = {.index = (int)list->len,
                                            .device = device,
                                            .turntable_deg = turntable_deg,
                                            .theta_deg = theta * 180 / G_PI,
                                            .phi_deg = phi * 180 / G_PI};
    g_array_append_val(list, added);
    return added.index;
}

/* Returns the index of the light or laser position of a row. Lights and laser positions differ by
 * the device and by its angle relative to the sample. */
static int source_of(struct import_set *set, const struct import_row *row) {
    const struct rig *rig = &set->known->rig;
    const double arc_rad = radians(row->arc_deg);
    const struct vec3 at_mm =
        row->sweep ? rig_laser_position_mm(&rig->arc, &rig->lasers[row->device], arc_rad)
                   : rig_lamp_position_mm(&rig->arc, &rig->lamps[row->device], arc_rad);
    return direction_index(row->sweep ? set->lasers : set->lights, row->device,
                           row->arc_deg - row->turntable_deg,
                           import_poses_direction(set, at_mm, row->turntable_deg),
                           row->sweep ? 0 : set->wish->same_light_deg);
}

static void make_shots(struct import_set *set) {
    g_array_sort(set->rows, compare_rows);
    const struct import_row *before = NULL;
    for (guint i = 0; i < set->rows->len; i++) {
        struct import_row *row = &g_array_index(set->rows, struct import_row, i);
        const struct vec3 eye_mm = rig_camera_centre_mm(&set->known->rig.cameras[row->camera]);
        row->view = direction_index(set->views, row->camera, row->turntable_deg,
                                    import_poses_direction(set, eye_mm, row->turntable_deg), 0);
        if (!before || compare_shots(before, row) != 0) {
            const struct session_shot shot = {.id = set->shots->len + 1,
                                              .kind = row->sweep ? SHOT_SWEEP : SHOT_LAMP,
                                              .pose = (int)set->shots->len,
                                              .turntable_deg = row->turntable_deg,
                                              .arc_deg = row->arc_deg,
                                              .source = source_of(set, row),
                                              .device = row->device};
            g_array_append_val(set->shots, shot);
        }
        row->shot = (int)set->shots->len - 1;
        camera_set_add(&g_array_index(set->shots, struct session_shot, row->shot).cameras,
                       row->camera);
        before = row;
    }
}

/* Returns FALSE with an error if two pictures have the same camera, pose and light, and in a sweep
 * also the same angle of the laser. */
static gboolean check_double(const struct import_set *set, GError **error) {
    for (guint i = 1; i < set->rows->len; i++) {
        const struct import_row *a = &g_array_index(set->rows, struct import_row, i - 1);
        const struct import_row *b = &g_array_index(set->rows, struct import_row, i);
        if (a->shot == b->shot && a->camera == b->camera &&
            (!a->sweep || a->sweep_deg == b->sweep_deg))
            return data_error_fail(set->table, b->line, error,
                                   "%s has the same camera, angles and light as the picture of "
                                   "line %d, %s; remove one of them",
                                   b->name, a->line, a->name);
    }
    return TRUE;
}

/* Adds a skipped shot for a picture that is missing in the table. Returns FALSE if it is not known
 * which lamp would have lit the picture. The lamp is known in two cases: it turns with the arc, or
 * another camera has a picture of the same pose under this light. */
static gboolean add_missing(struct import_set *set, int view_index, int light_index) {
    const struct session_direction *view =
        &g_array_index(set->views, struct session_direction, view_index);
    const struct session_direction *light =
        &g_array_index(set->lights, struct session_direction, light_index);
    struct session_shot shot = {.kind = SHOT_LAMP,
                                .turntable_deg = view->turntable_deg,
                                .arc_deg =
                                    remainder(light->turntable_deg + view->turntable_deg, 360),
                                .source = light_index,
                                .device = light->device,
                                .state = SHOT_SKIPPED,
                                .note = (char *)"not in the table of pictures"};
    gboolean known = !set->known->rig.lamps[light->device].fixed;
    for (guint i = 0; i < set->shots->len; i++) {
        struct session_shot *other = &g_array_index(set->shots, struct session_shot, i);
        if (other->kind != SHOT_LAMP || other->source != light_index ||
            steps(other->turntable_deg) != steps(view->turntable_deg))
            continue;
        if (other->state == SHOT_SKIPPED) { /* the shot was already added for another camera */
            camera_set_add(&other->cameras, view->device);
            return TRUE;
        }
        shot.arc_deg = other->arc_deg;
        shot.device = other->device;
        known = TRUE;
    }
    shot.id = set->shots->len + 1;
    shot.pose = (int)set->shots->len;
    shot.cameras = camera_set_of(view->device);
    if (known)
        g_array_append_val(set->shots, shot);
    return known;
}

static gboolean fail_missing(const struct import_set *set, const struct session_direction *view,
                             const struct session_direction *light, int n_missing, GError **error) {
    return data_error_fail(
        set->table, 0, error,
        "there is no picture of camera %s at turntable_deg %g under lamp %s at arc_deg %g, nor "
        "under another lamp in that direction. Every view needs at least nine lights in ten; this "
        "one lacks %d of %u. If lamps stand still and the sample turns, lamps that reach the same "
        "direction only roughly can be joined with --same-light. For pictures of a calibration "
        "target, without a BTF, use --target",
        set->known->rig.cameras[view->device].name, view->turntable_deg,
        set->known->rig.lamps[light->device].name,
        remainder(light->turntable_deg + view->turntable_deg, 360), n_missing, set->lights->len);
}

/* Checks that no view has two pictures for the BTF under one light, and that each view with such
 * pictures lacks at most BTF_MAX_MISSING of the lights. Adds skipped shots for the pictures that
 * are missing. Pictures of a calibration target are not checked. */
static gboolean check_lights(struct import_set *set, GError **error) {
    const guint n_views = set->views->len, n_lights = set->lights->len;
    if (set->wish->target)
        return TRUE;
    g_autofree const struct import_row **there =
        g_new0(const struct import_row *, MAX(n_views * n_lights, 1));
    g_autofree gboolean *any = g_new0(gboolean, MAX(n_views, 1));
    for (guint i = 0; i < set->rows->len; i++) {
        const struct import_row *row = &g_array_index(set->rows, struct import_row, i);
        const guint view = (guint)row->view;
        if (row->sweep)
            continue;
        const int light = g_array_index(set->shots, struct session_shot, row->shot).source;
        const struct import_row **other = &there[view * n_lights + (guint)light];
        if (*other)
            return data_error_fail(
                set->table, row->line, error,
                "%s and %s (line %d) show the same view, and their lamps are less "
                "than %g° (--same-light) apart, which makes them the same light; "
                "give a smaller --same-light, or leave one of the pictures out",
                row->name, (*other)->name, (*other)->line, set->wish->same_light_deg);
        *other = row;
        any[view] = TRUE;
    }
    for (guint view = 0; view < n_views; view++) {
        const struct session_direction *of =
            &g_array_index(set->views, struct session_direction, view);
        const struct session_direction *first = NULL;
        int missing = 0;
        gboolean ok = TRUE;
        for (guint light = 0; any[view] && light < n_lights; light++) {
            if (there[view * n_lights + light])
                continue;
            if (!first)
                first = &g_array_index(set->lights, struct session_direction, light);
            missing++;
            ok = add_missing(set, (int)view, (int)light) && ok;
        }
        if (missing > 0 && (!ok || missing > BTF_MAX_MISSING * n_lights))
            return fail_missing(set, of, first, missing, error);
        if (missing > 0 && set->wish->notes)
            g_ptr_array_add(
                set->wish->notes,
                g_strdup_printf("camera %s at turntable_deg %g lacks %d of its %u pictures under "
                                "lamps, for instance the one under %s at arc_deg %g; mesorig "
                                "process predicts and marks them",
                                set->known->rig.cameras[of->device].name, of->turntable_deg,
                                missing, n_lights, set->known->rig.lamps[first->device].name,
                                remainder(first->turntable_deg + of->turntable_deg, 360)));
        set->ret->n_missing += missing;
    }
    return TRUE;
}

/* Returns a new struct import_look (import_look.c), which fits the view that is nearest to the
 * normal of the sample. */
static struct import_look *new_look(const struct import_set *set) {
    const guint n = set->lights->len;
    g_autofree float *theta = g_new(float, MAX(n, 1)), *phi = g_new(float, MAX(n, 1));
    int steepest = 0;
    for (guint i = 0; i < n; i++) {
        const struct session_direction *light =
            &g_array_index(set->lights, struct session_direction, i);
        theta[i] = (float)light->theta_deg;
        phi[i] = (float)light->phi_deg;
    }
    for (guint i = 0; i < set->views->len; i++)
        if (set->first[i] &&
            (!set->first[steepest] ||
             g_array_index(set->views, struct session_direction, i).theta_deg <
                 g_array_index(set->views, struct session_direction, steepest).theta_deg))
            steepest = (int)i;
    return import_look_new(set->wish->transfer, (int)set->views->len, (int)n, theta, phi, steepest);
}

static gboolean make(struct import_set *set, const char *path, const struct work *work,
                     GError **error) {
    struct import_place place;
    make_shots(set);
    if (!check_double(set, error) || !check_lights(set, error) || !import_frames_plan(set, error) ||
        !import_frames_prepare(set, error) || !import_place_begin(&place, path, error))
        return FALSE;
    g_autofree char *calibration = calibration_to_text(set->known);
    g_autofree char *where = g_canonicalize_filename(set->wish->calibration, NULL);
    gboolean calibrated = FALSE;
    for (int i = 0; i < CALIBRATION_PARTS; i++)
        calibrated |= set->known->parts[i].done;
    const char *const values[][2] = {{"calibration", calibrated ? where : "nominal"}};
    const struct session_texts texts = {.rig_conf = IMPORT_NO_TEXT,
                                        .session_conf = IMPORT_NO_TEXT,
                                        .calibration = calibration,
                                        .values = values,
                                        .n_values = G_N_ELEMENTS(values)};
    const struct session_plan plan = {
        .grid = set->wish->grid,
        .views = (const struct session_direction *)(gpointer)set->views->data,
        .n_views = (int)set->views->len,
        .lights = (const struct session_direction *)(gpointer)set->lights->data,
        .n_lights = (int)set->lights->len,
        .lasers = (const struct session_direction *)(gpointer)set->lasers->data,
        .n_lasers = (int)set->lasers->len,
        .shots = (const struct session_shot *)(gpointer)set->shots->data,
        .n_shots = (int)set->shots->len};
    set->look = new_look(set);
    set->session = session_create(place.session, place.name, &texts, &plan, error);
    const gboolean ok = set->session && import_frames_write(set, work, error) &&
                        import_look_tell(set->look, set->session, set->wish->notes, error) &&
                        session_set_value(set->session, "imported_frames", set->table, error) &&
                        session_set_value(set->session, "state", "done", error);
    return import_place_end(&place, set->session, ok, error);
}

/* Adds a note for each camera that looks straight down. The rotation of its pictures is an
 * assumption, because nothing in the pictures shows it. */
static void tell_downward(const struct import_set *set) {
    const struct rig *rig = &set->known->rig;
    for (int c = 0; set->wish->notes && c < rig->n_cameras; c++) {
        const struct rig_camera *camera = &rig->cameras[c];
        const double *right = camera->rotation.m[0];
        if (!nominal_looks_down(camera))
            continue;
        double azimuth = atan2(right[1], right[0]) * 180 / G_PI;
        azimuth = azimuth < -0.5 ? azimuth + 360 : azimuth;
        g_ptr_array_add(
            set->wish->notes,
            g_strdup_printf(
                "camera %s looks straight down. The right side of its pictures is assumed to point "
                "to %.0f° (0° is x, 90° is y); correct turn_deg in %s if it does not",
                camera->name, fabs(azimuth), set->wish->calibration));
    }
}

/* Adds a note if no picture has a dark frame. Only dark frames contain the offsets of columns and
 * pixels; a black level does not. */
static void tell_dark_frames(const struct import_set *set) {
    for (guint i = 0; i < set->rows->len; i++)
        if (g_array_index(set->rows, struct import_row, i).coding.dark_path)
            return;
    if (set->wish->notes)
        g_ptr_array_add(set->wish->notes,
                        g_strdup("no picture has a dark_frame: offsets of single columns or pixels "
                                 "of the sensor stay in the values, and are in no error bar"));
}

gboolean import_poses(const char *path, const struct import_poses *poses, const struct work *work,
                      struct import_poses_result *ret, GError **error) {
    struct import_set set = {
        .wish = poses,
        .table = poses->table,
        .ret = ret,
        .flats = g_hash_table_new_full(g_str_hash, g_str_equal, g_free,
                                       (GDestroyNotify)import_picture_free),
        .darks = g_hash_table_new_full(g_str_hash, g_str_equal, g_free, import_coding_free_dark),
        .rows = g_array_new(FALSE, FALSE, sizeof(struct import_row)),
        .views = g_array_new(FALSE, FALSE, sizeof(struct session_direction)),
        .lights = g_array_new(FALSE, FALSE, sizeof(struct session_direction)),
        .lasers = g_array_new(FALSE, FALSE, sizeof(struct session_direction)),
        .shots = g_array_new(FALSE, FALSE, sizeof(struct session_shot))};
    g_autoptr(TextTable) table = poses_table_read(poses->table, error);
    *ret = (struct import_poses_result){0};
    g_array_set_clear_func(set.rows, clear_row);
    const gboolean ok = table && (set.known = nominal_read(poses->calibration, error)) &&
                        read_rows(&set, table, error) && make(&set, path, work, error);
    if (ok) {
        tell_downward(&set);
        tell_dark_frames(&set);
    }
    ret->n_views = (int)set.views->len;
    ret->n_lights = (int)set.lights->len;
    ret->n_lasers = (int)set.lasers->len;
    ret->n_shots = (int)set.shots->len;
    g_hash_table_unref(set.flats);
    g_hash_table_unref(set.darks);
    g_free(set.first);
    g_free(set.in_colour);
    g_array_unref(set.rows);
    g_array_unref(set.views);
    g_array_unref(set.lights);
    g_array_unref(set.lasers);
    g_array_unref(set.shots);
    import_look_free(set.look);
    calibration_free(set.known);
    return ok;
}
