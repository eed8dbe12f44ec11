/* The notes of a plan: which shots and poses were changed or left out, and how values of the
 * session file affect time, disk space and result. */
#include "plan_private.h"

/* a note is added if texels are smaller than this part of a pixel of the finest camera */
#define FINE_TEXEL      0.5
#define BTF_VALUE_BYTES 6 /* red, green and blue, as half floats */

void plan_add_note(struct plan_build *b, const char *unit, const char *text) {
    for (guint i = 0; i < b->notes->len; i++) {
        struct plan_note *known = &g_array_index(b->notes, struct plan_note, i);
        if (g_str_equal(known->text, text)) {
            known->n++;
            return;
        }
    }
    const struct plan_note note = {g_strdup(text), unit, 1};
    g_array_append_val(b->notes, note);
}

void plan_clear_note(gpointer note) {
    g_free(((struct plan_note *)note)->text);
}

/* Adds a note with the values that the plan assumes for the keys that are "auto" and not chosen
 * yet. */
static void note_auto(const struct session_conf *conf, GPtrArray *notes) {
    g_autoptr(GString) bounds = g_string_new(NULL);

    if (conf->is_auto[AUTO_EXPOSURES]) {
        g_string_append_printf(bounds, "%s ", auto_key_names[AUTO_EXPOSURES]);
        for (int i = 0; i < conf->n_exposures; i++)
            g_string_append_printf(bounds, "%s%g", i ? "; " : "", conf->exposures_us[i]);
    }
    const double lasers_us[] = {
        [AUTO_LASER] = conf->laser_exposure_us, [AUTO_SHORT] = conf->laser_short_us};
    for (int key = AUTO_LASER; key < AUTO_KEYS; key++)
        if (conf->is_auto[key])
            g_string_append_printf(bounds, "%s%s %g", bounds->len ? ", " : "", auto_key_names[key],
                                   lasers_us[key]);
    if (bounds->len)
        g_ptr_array_add(notes, g_strdup_printf("time and space are upper bounds: \"auto\" is taken "
                                               "as %s (µs); [capture] auto_longest_us, %g, is the "
                                               "longest that auto may choose",
                                               bounds->str, conf->auto_longest_us));
}

static void note_stop(const struct plan_build *b, const struct plan *plan, GPtrArray *notes) {
    if (b->conf->laser_stop == STOP_ALL)
        return;
    if (plan->n_later_sweeps > 0)
        g_ptr_array_add(
            notes,
            g_strdup_printf(
                "[lasers] stop = covered: %d of the sweeps are only taken if the sweeps before "
                "them leave something unseen; the predicted time and frames are for all of them",
                plan->n_later_sweeps));
    else
        g_ptr_array_add(notes,
                        g_strdup_printf("[lasers] stop = covered: the first round already has all "
                                        "sweeps, since no angle of the turntable has more than "
                                        "first = %d, so that none can be saved",
                                        b->conf->laser_first));
}

static void note_sampling(const struct plan_build *b, const struct plan *plan, GPtrArray *notes) {
    if (b->conf->light_sampling == SAMPLING_ALL)
        return;
    if (plan->n_later_lamps > 0)
        g_ptr_array_add(
            notes, g_strdup_printf("[lights] sampling = adaptive: %d of the shots of lamps are "
                                   "only taken if they cannot be predicted from the shots before "
                                   "them; the predicted time and frames are for all of them",
                                   plan->n_later_lamps));
    else
        g_ptr_array_add(notes,
                        g_strdup_printf("[lights] sampling = adaptive: the first round already has "
                                        "all shots of lamps, since no angle of the turntable has "
                                        "more than first = %d, so that none can be saved",
                                        b->conf->light_first));
}

static void note_motion(const struct plan_build *b, const struct plan *plan, GPtrArray *notes) {
    if (b->conf->motion != MOTION_CONTINUOUS)
        return;
    const struct passes_speed *speed = &plan->passes;
    if (plan->n_passes == 0)
        g_ptr_array_add(notes,
                        g_strdup("motion = continuous: the turntable stands still for all shots, "
                                 "because a stop at each angle is quicker than any pass"));
    else
        g_ptr_array_add(
            notes, g_strdup_printf("motion = continuous: the speed of passes is limited by %s",
                                   speed->by_axis   ? "the maximum speed of the turntable"
                                   : speed->by_pose ? "blur_texels and the accuracy of the time "
                                                      "stamps of camera and turntable"
                                                    : "blur_texels and the exposure"));
    if (plan->n_passes > 0 && plan->predicted_s >= plan->standing_s)
        g_ptr_array_add(notes, g_strdup("motion = continuous is no quicker here than motion = "
                                        "standing, which has no blur"));
}

static void note_bytes(const struct plan_build *b, GPtrArray *notes) {
    gboolean vary = FALSE, sweeps = FALSE;
    for (guint i = 0; i < b->shots->len; i++) {
        const struct session_shot *shot = &g_array_index(b->shots, struct session_shot, i);
        for (int c = 0; c < b->rig->n_cameras && shot->state == SHOT_PLANNED; c++)
            if (camera_set_has(shot->cameras, c) && plan_bytes_vary(&b->rig->cameras[c])) {
                vary = TRUE;
                sweeps |= shot->kind == SHOT_SWEEP;
            }
    }
    if (vary)
        g_ptr_array_add(
            notes,
            g_strdup_printf(
                "frames of more than 256² pixels are compressed, and their size depends on their "
                "content; %smesorig status tells what the session will take by the frames stored "
                "so far",
                sweeps ? "pixels that do not see the line of a laser sweep take almost no space; "
                       : ""));
}

/* Adds a note if texels are much finer than the pixels of the finest camera: they show no more
 * detail and take more space. */
static void note_texels(const struct plan_build *b, GPtrArray *notes) {
    const struct session_grid *grid = &b->conf->grid;
    const double texel_mm = grid->width_mm / grid->width;
    double finest_mm = G_MAXDOUBLE;
    const char *name = "";

    for (int c = 0; c < b->rig->n_cameras; c++) {
        const struct rig_camera *camera = &b->rig->cameras[c];
        const double pixel_mm = vec3_length(rig_camera_centre_mm(camera)) / camera->fx_px;
        gboolean planned = FALSE;
        for (guint i = 0; i < b->views->len && !planned; i++)
            planned = g_array_index(b->views, struct session_direction, i).device == c;
        if (planned && pixel_mm < finest_mm) {
            finest_mm = pixel_mm;
            name = camera->name;
        }
    }
    if (finest_mm == G_MAXDOUBLE || texel_mm >= FINE_TEXEL * finest_mm)
        return;
    g_autofree char *size = g_format_size((guint64)grid->width * (guint64)grid->height *
                                          b->views->len * b->lights->len * BTF_VALUE_BYTES);
    g_ptr_array_add(notes, g_strdup_printf("a texel is %.2g mm wide, but a pixel of camera %s, the "
                                           "finest, sees %.2g mm: texels = %.0f shows as much; the "
                                           "BTF would take %s before it is compressed",
                                           texel_mm, name, finest_mm,
                                           ceil(grid->width_mm / finest_mm), size));
}

/* Adds a note if the session has only one view, or if the rig has no turntable. */
static void note_views(const struct plan_build *b, GPtrArray *notes) {
    if (b->views->len == 1)
        g_ptr_array_add(notes, g_strdup("one view: the session will have its pictures under each "
                                        "light (an RTI set, for PTM and HSH) and no other views"));
    else if (plan_is_absent(&b->timing->turntable))
        g_ptr_array_add(notes, g_strdup_printf("no turntable: %u views, where the cameras stand; "
                                               "directions between them will only be interpolated",
                                               b->views->len));
}

GPtrArray *plan_tell_notes(const struct plan_build *b, const struct plan *plan) {
    GPtrArray *notes = g_ptr_array_new_with_free_func(g_free);
    for (guint i = 0; i < b->notes->len; i++) {
        const struct plan_note *note = &g_array_index(b->notes, struct plan_note, i);
        g_ptr_array_add(notes, g_strdup_printf("%d %s%s: %s", note->n, note->unit,
                                               note->n == 1 ? "" : "s", note->text));
    }
    note_auto(b->conf, notes);
    note_stop(b, plan, notes);
    note_sampling(b, plan, notes);
    note_motion(b, plan, notes);
    note_texels(b, notes);
    note_bytes(b, notes);
    note_views(b, notes);
    return notes;
}
