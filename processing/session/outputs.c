/* The output of a shot is the mean of the outputs that its cameras measured, weighted by 1/σ². σ²
 * is the squared error of a camera's measurement plus CALIBRATION_ERROR². */
#include "outputs.h"
#include "session_private.h"

#include <math.h>
#include <string.h>

#define PREFIX "lamp_output/"
/* Error of the calibration, which is added to the error of each camera. Without it, one camera with
 * little noise would outweigh the others. */
#define CALIBRATION_ERROR 1e-3

struct output {
    double sum, weight, value;
    int lamp; /* index of the shot's lamp; −1 if no lamp lights the shot */
};

struct outputs {
    struct output *of; /* output of each shot, indexed by the shot's id (from 1) */
    gint64 n;
};

gboolean outputs_store(Session *session, gint64 shot, const char *camera, double output,
                       double output_error, GError **error) {
    char value[G_ASCII_DTOSTR_BUF_SIZE], own[G_ASCII_DTOSTR_BUF_SIZE];
    g_autofree char *key = g_strdup_printf(PREFIX "%" G_GINT64_FORMAT "/%s", shot, camera);
    g_autofree char *text = g_strdup_printf("%s %s", g_ascii_dtostr(value, sizeof value, output),
                                            g_ascii_dtostr(own, sizeof own, output_error));
    return session_set_value(session, key, text, error);
}

static gboolean add_all(struct outputs *outputs, Session *session, const GPtrArray *shots,
                        OutputsFactor factor, gpointer data, GError **error) {
    g_autoptr(GHashTable) values = session_values(session, PREFIX, error);
    GHashTableIter iter;
    gpointer key, value;
    if (!values)
        return FALSE;
    g_hash_table_iter_init(&iter, values);
    while (g_hash_table_iter_next(&iter, &key, &value)) {
        char *slash = NULL, *end = NULL;
        gint64 shot = g_ascii_strtoll((char *)key + strlen(PREFIX), &slash, 10);
        double output = g_ascii_strtod(value, &end);
        double own = *end == ' ' ? g_ascii_strtod(end + 1, &end) : -1;
        if (*slash != '/' || shot < 1 || shot > outputs->n || *end != '\0' ||
            !(output > 1e-3 && output < 1e3) || !(own >= 0 && own < 1e3))
            return session_fail(
                error, SESSION_ERROR_FORMAT,
                "%s/session.db: the value %s is \"%s\", but must be a lamp's output, "
                "0.001 to 1000, and its error, 0 to 1000; restore the database from "
                "a copy",
                session_path(session), (char *)key, (char *)value);
        if (factor) {
            const double by = factor(g_ptr_array_index(shots, (guint)shot - 1), slash + 1, data);
            output *= by;
            own *= by;
        }
        double weight = 1 / (own * own + CALIBRATION_ERROR * CALIBRATION_ERROR);
        outputs->of[shot].sum += weight * output;
        outputs->of[shot].weight += weight;
    }
    return TRUE;
}

/* Returns the shot nearest to a shot in one direction (−1 or +1) that has the same lamp and was
 * measured. Returns 0 if there is none. */
static gint64 nearest(const struct outputs *outputs, gint64 shot, int direction) {
    for (gint64 i = shot + direction; i >= 1 && i <= outputs->n; i += direction)
        if (outputs->of[i].weight > 0 && outputs->of[i].lamp == outputs->of[shot].lamp)
            return i;
    return 0;
}

/* Returns the output of a shot that was not measured. The output is interpolated linearly between
 * the nearest measured shots of its lamp before and after the shot. If the lamp has measured shots
 * on one side only, the output of the nearest of them is returned. If it has none at all, 1 is
 * returned. */
static double between(const struct outputs *outputs, gint64 shot) {
    gint64 before = nearest(outputs, shot, -1), after = nearest(outputs, shot, 1);
    if (before == 0 && after == 0)
        return 1;
    if (before == 0 || after == 0)
        return outputs->of[MAX(before, after)].value;
    double part = (double)(shot - before) / (double)(after - before);
    return (1 - part) * outputs->of[before].value + part * outputs->of[after].value;
}

struct outputs *outputs_load(Session *session, const GPtrArray *shots, GError **error) {
    return outputs_load_relative(session, shots, NULL, NULL, error);
}

struct outputs *outputs_load_relative(Session *session, const GPtrArray *shots,
                                      OutputsFactor factor, gpointer data, GError **error) {
    struct outputs *outputs = g_new0(struct outputs, 1);
    outputs->n = shots->len;
    outputs->of = g_new0(struct output, shots->len + 1);
    for (guint i = 0; i < shots->len; i++) {
        const struct session_shot *shot = g_ptr_array_index(shots, i);
        outputs->of[i + 1].value = 1;
        outputs->of[i + 1].lamp = shot->kind == SHOT_LAMP ? shot->device : -1;
    }
    if (!add_all(outputs, session, shots, factor, data, error)) {
        outputs_free(outputs);
        return NULL;
    }
    for (gint64 i = 1; i <= outputs->n; i++)
        if (outputs->of[i].weight > 0)
            outputs->of[i].value = outputs->of[i].sum / outputs->of[i].weight;
    for (gint64 i = 1; i <= outputs->n; i++)
        if (outputs->of[i].weight == 0 && outputs->of[i].lamp >= 0)
            outputs->of[i].value = between(outputs, i);
    return outputs;
}

void outputs_free(struct outputs *outputs) {
    if (!outputs)
        return;
    g_free(outputs->of);
    g_free(outputs);
}

double outputs_of(const struct outputs *outputs, gint64 shot) {
    return shot >= 1 && shot <= outputs->n ? outputs->of[shot].value : 1;
}

double outputs_error(const struct outputs *outputs, gint64 shot) {
    const gboolean known = shot >= 1 && shot <= outputs->n && outputs->of[shot].weight > 0;
    return known ? 1 / sqrt(outputs->of[shot].weight) : 0;
}
