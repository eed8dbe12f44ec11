#include "flights.h"

#include <math.h>

#include "radiometry/fiducials.h"

struct flight *flights_find(const struct flights *flights, const struct session_shot *shot) {
    for (const GList *at = flights->queue.tail; at; at = at->prev)
        if (((struct flight *)at->data)->shot == shot)
            return at->data;
    return NULL;
}

struct flight *flights_add(struct flights *flights, const struct session_shot *shot) {
    struct flight *flight = flights_find(flights, shot);
    if (!flight) {
        flight = g_new0(struct flight, 1);
        flight->shot = shot;
        flight->signal_dn = -HUGE_VAL;
        g_queue_push_tail(&flights->queue, flight);
    }
    return flight;
}

guint flights_n(const struct flights *flights) {
    return flights->queue.length;
}

const struct flight *flights_at(const struct flights *flights, guint index) {
    return g_queue_peek_nth((GQueue *)&flights->queue, index);
}

void flight_take(struct flight *flight, const struct intake_result *result) {
    const int camera = result->frame.camera;
    camera_set_add(&flight->back, camera);
    flight->frames[camera] = result->frame;
    flight->frames[camera].path = g_strdup(result->frame.path);
    flight->frames[camera].sha256 = g_strdup(result->frame.sha256);
    flight->signals_dn[camera] = result->signal_dn;
    flight->signal_dn = MAX(flight->signal_dn, result->signal_dn);
    if (!result->marks)
        return;
    if (!flight->marks)
        flight->marks = g_array_new(FALSE, FALSE, sizeof(struct fiducial_seen));
    g_array_append_vals(flight->marks, result->marks->data, result->marks->len);
}

static gboolean is_back(const struct flight *flight) {
    return camera_set_equal(flight->back, flight->shot->cameras);
}

gboolean flights_are_back(const struct flights *flights) {
    return flights_first_are_back(flights, flights_n(flights));
}

gboolean flights_first_are_back(const struct flights *flights, guint n) {
    for (guint i = 0; i < n; i++) {
        const struct flight *flight = flights_at(flights, i);
        if (!flight || !is_back(flight))
            return FALSE;
    }
    return TRUE;
}

static void flight_free(gpointer data) {
    struct flight *flight = data;
    for (int c = 0; c < RIG_MAX_CAMERAS; c++) {
        g_free(flight->frames[c].path);
        g_free(flight->frames[c].sha256);
    }
    if (flight->marks)
        g_array_unref(flight->marks);
    g_free(flight);
}

void flights_drop_first(struct flights *flights) {
    flight_free(g_queue_pop_head(&flights->queue));
}

void flights_clear(struct flights *flights) {
    g_queue_clear_full(&flights->queue, flight_free);
}
