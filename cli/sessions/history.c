#include "history.h"

#include "common/plot.h"
#include "plan/report.h"

#include <math.h>

#define LEFT     90.0
#define RIGHT    (PLOT_WIDTH - 40.0)
#define MAX_TICK 12

struct colour {
    double r, g, b;
};

static const struct colour ink = {0.13, 0.14, 0.16}, faint = {0.85, 0.86, 0.88},
                           turntable = {0.09, 0.42, 0.71}, arc = {0.85, 0.43, 0.10},
                           warning = {0.93, 0.60, 0.05}, fault = {0.80, 0.10, 0.14};
static const struct colour kinds[] = {[SHOT_DARK] = {0.35, 0.36, 0.40},
                                      [SHOT_LAMP] = {0.96, 0.80, 0.28},
                                      [SHOT_SWEEP] = {0.80, 0.20, 0.27}};
static const struct colour rest = {0.72, 0.73, 0.75};

struct take { /* a captured shot, and the time at which its last frame was taken */
    double end_s;
    const struct session_shot *shot;
};

struct history {
    cairo_t *cr;
    GPtrArray *shots, *frames, *events;
    GArray *takes; /* of struct take, sorted by time */
    double end_s, bound_s;
    int retakes;
};

static int by_time(gconstpointer a, gconstpointer b) {
    const double x = ((const struct take *)a)->end_s, y = ((const struct take *)b)->end_s;
    return (x > y) - (x < y);
}

/* Makes one take for each captured shot, with the time of its last frame. Sorts the takes by time.
 * The frames of a shot are adjacent, because the rows of frames are sorted by shot. */
static void collect_takes(struct history *h) {
    guint s = 0;
    h->takes = g_array_new(FALSE, FALSE, sizeof(struct take));
    for (guint f = 0; f < h->frames->len; f++) {
        const struct session_frame *frame = h->frames->pdata[f];
        struct take *last =
            h->takes->len ? &g_array_index(h->takes, struct take, h->takes->len - 1) : NULL;
        h->retakes += frame->retakes;
        if (!isfinite(frame->captured_s))
            continue;
        h->end_s = MAX(h->end_s, frame->captured_s);
        if (last && last->shot->id == frame->shot) {
            last->end_s = MAX(last->end_s, frame->captured_s);
            continue;
        }
        while (s < h->shots->len && ((struct session_shot *)h->shots->pdata[s])->id != frame->shot)
            s++;
        if (s == h->shots->len)
            break;
        const struct take take = {.end_s = frame->captured_s, .shot = h->shots->pdata[s]};
        g_array_append_val(h->takes, take);
    }
    g_array_sort(h->takes, by_time);
}

static void set_colour(const struct history *h, struct colour c, double alpha) {
    cairo_set_source_rgba(h->cr, c.r, c.g, c.b, alpha);
}

static double x_of(const struct history *h, double time_s) {
    return LEFT + (RIGHT - LEFT) * time_s / MAX(h->end_s, h->bound_s);
}

static void draw_line(const struct history *h, double x0, double y0, double x1, double y1) {
    cairo_move_to(h->cr, x0, y0);
    cairo_line_to(h->cr, x1, y1);
    cairo_stroke(h->cr);
}

/* Draws the time axis of a panel with at most about MAX_TICK marks. */
static void draw_time(const struct history *h, double top, double bottom, gboolean labels) {
    static const int steps[] = {1,   2,   5,    10,   15,   30,    60,    120,   300,
                                600, 900, 1800, 3600, 7200, 14400, 28800, 86400, 604800};
    const double end = MAX(h->end_s, h->bound_s);
    guint i = 0;
    while (i + 1 < G_N_ELEMENTS(steps) && end / steps[i] > MAX_TICK)
        i++;
    const int n = (int)fmin(end / steps[i], 1000);
    for (int k = 0; k <= n; k++) {
        const int t = k * steps[i];
        set_colour(h, faint, 1);
        draw_line(h, x_of(h, t), top, x_of(h, t), bottom);
        set_colour(h, ink, 1);
        g_autofree char *text = steps[i] < 60 ? g_strdup_printf("%d s", t)
                                : end < 7200  ? g_strdup_printf("%d min", t / 60)
                                              : g_strdup_printf("%d:%02d h", t / 3600, t / 60 % 60);
        if (labels)
            plot_text(h->cr, x_of(h, t), bottom + 24, 0.5, text);
    }
}

static void draw_scale(const struct history *h, double top, double bottom, int to, int step,
                       const char *unit) {
    for (int v = 0; v <= to; v += step) {
        const double y = bottom - (bottom - top) * v / to;
        g_autofree char *text = g_strdup_printf("%d %s", v, unit);
        set_colour(h, faint, 1);
        draw_line(h, LEFT, y, RIGHT, y);
        set_colour(h, ink, 1);
        plot_text(h->cr, LEFT - 10, y + 6, 1, text);
    }
}

static void draw_progress(const struct history *h, double top, double bottom) {
    const double each = (bottom - top) / h->shots->len;
    draw_time(h, top, bottom, FALSE);
    draw_scale(h, top, bottom, 100, 25, "%");
    if (h->bound_s > 0) {
        const double dash[] = {8, 6};
        set_colour(h, ink, 0.7);
        cairo_set_dash(h->cr, dash, 2, 0);
        draw_line(h, x_of(h, h->bound_s), top, x_of(h, h->bound_s), bottom);
        cairo_set_dash(h->cr, NULL, 0, 0);
        plot_text(h->cr, x_of(h, h->bound_s) - 8, bottom - 10, 1, "lower bound of any order");
    }
    set_colour(h, turntable, 1);
    cairo_set_line_width(h->cr, 3);
    cairo_move_to(h->cr, LEFT, bottom);
    for (guint i = 0; i < h->takes->len; i++)
        cairo_line_to(h->cr, x_of(h, g_array_index(h->takes, struct take, i).end_s),
                      bottom - each * (i + 1));
    cairo_stroke(h->cr);
    cairo_set_line_width(h->cr, 1);
}

/* Marks warnings and errors at their times. `mesorig info` lists their texts. */
static void draw_events(const struct history *h, double top, double bottom) {
    for (guint i = 0; i < h->events->len; i++) {
        const struct session_event *event = h->events->pdata[i];
        const gboolean error = g_str_equal(event->level, "error");
        if (!error && !g_str_equal(event->level, "warning"))
            continue;
        const double x = x_of(h, CLAMP(event->time_s, 0, h->end_s));
        set_colour(h, error ? fault : warning, 0.9);
        draw_line(h, x, top, x, bottom);
        cairo_move_to(h->cr, x - 6, top);
        cairo_line_to(h->cr, x + 6, top);
        cairo_line_to(h->cr, x, top + 10);
        cairo_fill(h->cr);
    }
}

static void draw_angles(const struct history *h, double top, double bottom) {
    draw_time(h, top, bottom, FALSE);
    draw_scale(h, top, bottom, 360, 90, "°");
    for (guint i = 0; i < h->takes->len; i++) {
        const struct take *take = &g_array_index(h->takes, struct take, i);
        const double degrees[2] = {take->shot->arc_deg, take->shot->turntable_deg};
        for (int k = 0; k < 2; k++) {
            const double turn = fmod(degrees[k], 360);
            set_colour(h, k ? turntable : arc, k ? 0.9 : 0.8);
            cairo_arc(h->cr, x_of(h, take->end_s),
                      bottom - (bottom - top) * (turn < 0 ? turn + 360 : turn) / 360, 1.7, 0,
                      2 * G_PI);
            cairo_fill(h->cr);
        }
    }
}

/* Returns the time at which the axes were last homed between from_s and to_s. Returns from_s if
 * they were not homed. The time before this homing was lost, because a fault or an abort had
 * interrupted a shot. */
static double homed_s(const struct history *h, double from_s, double to_s) {
    double at_s = from_s;
    for (guint i = 0; i < h->events->len; i++) {
        const struct session_event *event = h->events->pdata[i];
        if (g_str_equal(event->message, SESSION_EVENT_HOMED) && event->time_s > from_s &&
            event->time_s < to_s)
            at_s = MAX(at_s, event->time_s);
    }
    return at_s;
}

static void draw_span(const struct history *h, double from_s, double to_s, double top,
                      double bottom, struct colour colour) {
    const double from = x_of(h, from_s), to = x_of(h, to_s);
    set_colour(h, colour, 1);
    cairo_rectangle(h->cr, from, top, to - from + 0.3, bottom - top);
    cairo_fill(h->cr);
}

static void draw_kinds(const struct history *h, double top, double bottom) {
    double from_s = 0;
    for (guint i = 0; i < h->takes->len; i++) {
        const struct take *take = &g_array_index(h->takes, struct take, i);
        const double begun_s = homed_s(h, from_s, take->end_s);
        if (begun_s > from_s)
            draw_span(h, from_s, begun_s, top, bottom, rest);
        draw_span(h, begun_s, take->end_s, top, bottom, kinds[take->shot->kind]);
        from_s = take->end_s;
    }
    draw_time(h, bottom, bottom + 6, TRUE);
}

static void draw_keys(const struct history *h, double y) {
    const struct {
        struct colour colour;
        const char *name;
    } keys[] = {{turntable, "turntable"},
                {arc, "light arc"},
                {kinds[SHOT_LAMP], "lamps"},
                {kinds[SHOT_SWEEP], "laser sweeps"},
                {kinds[SHOT_DARK], "dark frames"},
                {rest, "homing"},
                {warning, "warning"},
                {fault, "error"}};
    double x = LEFT;
    for (gsize i = 0; i < G_N_ELEMENTS(keys); i++) {
        cairo_text_extents_t size;
        set_colour(h, keys[i].colour, 1);
        cairo_rectangle(h->cr, x, y - 11, 12, 12);
        cairo_fill(h->cr);
        set_colour(h, ink, 1);
        plot_text(h->cr, x + 18, y, 0, keys[i].name);
        cairo_text_extents(h->cr, keys[i].name, &size);
        x += 42 + size.x_advance;
    }
}

static gboolean read_session(struct history *h, Session *session, GError **error) {
    g_autofree char *bound = session_value(session, "lower_bound_s");
    h->bound_s = bound ? g_ascii_strtod(bound, NULL) : 0;
    if (!(h->bound_s > 0 && isfinite(h->bound_s)))
        h->bound_s = 0;
    h->shots = session_shots(session, error);
    h->frames = h->shots ? session_frames(session, error) : NULL;
    h->events = h->frames ? session_events(session, error) : NULL;
    if (!h->events)
        return FALSE;
    collect_takes(h);
    if (h->takes->len > 0 && h->end_s > 0)
        return TRUE;
    g_set_error(
        error, SESSION_ERROR, SESSION_ERROR_FORMAT,
        "%s: nothing was captured yet, so there is no history to draw: capture the session first",
        session_path(session));
    return FALSE;
}

gboolean history_draw(Session *session, const char *path, GError **error) {
    struct history h = {0};
    gboolean ok = read_session(&h, session, error) && (h.cr = plot_new(path, error));
    if (ok) {
        g_autofree char *time = report_duration(h.end_s);
        g_autofree char *retakes =
            h.retakes ? g_strdup_printf("%d retakes", h.retakes) : g_strdup("no retakes");
        g_autofree char *title =
            g_strdup_printf("%s: %u of %u shots in %s, %u frames kept, %s", session_name(session),
                            h.takes->len, h.shots->len, time, h.frames->len, retakes);
        cairo_set_line_width(h.cr, 1);
        plot_title(h.cr, LEFT, 48, title, NULL);
        draw_progress(&h, 80, 380);
        draw_angles(&h, 420, 620);
        draw_events(&h, 80, 620);
        draw_kinds(&h, 650, 690);
        draw_keys(&h, 760);
        ok = plot_finish(h.cr, path, error);
    }
    g_clear_pointer(&h.shots, g_ptr_array_unref);
    g_clear_pointer(&h.frames, g_ptr_array_unref);
    g_clear_pointer(&h.events, g_ptr_array_unref);
    g_clear_pointer(&h.takes, g_array_unref);
    return ok;
}
