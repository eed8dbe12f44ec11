/* Checks of a camera: “trigger” takes a picture, which is a PGM file in the folder that “hello” has
 * named. */
#include "checks.h"

#include "program/message.h"
#include "program/pgm.h"

#include <math.h>
#include <string.h>

#define EXPOSURE_US 10000
/* Exposure of the first picture. A camera must not answer before the exposure has ended. Such an
 * early answer is noticed only if the exposure is longer than the delays of the computer, which may
 * be longer than EXPOSURE_US. */
#define FIRST_US   100000
#define STOPPED_US 1000000 /* exposure that is stopped */
#define SHORT_US   300000  /* The program may end a shorter exposure before it reads “stop”. */
#define STOP_MS    100     /* time from “trigger” to “stop” */

/* Returns the exposure of the camera that is nearest to the wanted one. */
static gint64 exposure(const struct bench *bench, gint64 wanted_us) {
    const struct camera_format *format = &bench->format;
    gint64 best_us = CLAMP(wanted_us, format->min_exposure_us, format->max_exposure_us);
    for (int i = 0; i < format->n_exposures; i++)
        if (i == 0 || ABS(format->exposures_us[i] - wanted_us) < ABS(best_us - wanted_us))
            best_us = format->exposures_us[i];
    return best_us;
}

static void send_trigger(struct bench *bench, gint64 exposure_us, double gain_db, guint64 *ret_id) {
    JsonObject *params = json_object_new();
    bench->exposure_us = exposure_us;
    json_object_set_int_member(params, "shot", (gint64)++bench->shot);
    json_object_set_int_member(params, "exposure_us", exposure_us);
    json_object_set_double_member(params, "gain_db", gain_db);
    g_autofree char *line = bench_line(bench, "trigger", params, ret_id);
    bench->trigger_id = *ret_id;
    bench_write(bench, line);
}

/* Checks the number and the times of a picture. */
static gboolean check_times(struct bench *bench, JsonObject *values, gint64 exposure_us,
                            gint64 sent_us, gint64 answered_us) {
    g_autoptr(GError) error = NULL;
    gint64 id, start_us = sent_us;
    if (!message_integer(values, "id", 0, G_MAXINT64, &id, &error) ||
        (json_object_has_member(values, "exposure_start_us") &&
         !message_integer(values, "exposure_start_us", 0, G_MAXINT64, &start_us, &error)))
        return bench_fail(bench, "see the table of requests in docs/build-a-rig/programs.md",
                          "the number “id”", "the program %s", error->message);
    if (id <= bench->picture_id)
        return bench_fail(bench, "count the pictures",
                          "an “id” greater than that of the picture before",
                          "%" G_GINT64_FORMAT " after %" G_GINT64_FORMAT, id, bench->picture_id);
    bench->picture_id = id;
    if (start_us > answered_us)
        return bench_fail(bench, "take the time from CLOCK_MONOTONIC, in µs",
                          "an “exposure_start_us” before the answer", "%.1f ms after it",
                          (double)(start_us - answered_us) / 1000);
    if (start_us < sent_us)
        return bench_fail(bench,
                          "answer with the picture of this trigger, and take the time from "
                          "CLOCK_MONOTONIC",
                          "an “exposure_start_us” after the trigger", "%.1f ms before it",
                          (double)(sent_us - start_us) / 1000);
    return start_us + exposure_us <= answered_us ||
           bench_fail(bench,
                      "answer “trigger” when the picture is there, and expose for exposure_us",
                      "an answer after the end of the exposure", "an answer %.1f ms before it",
                      (double)(start_us + exposure_us - answered_us) / 1000);
}

/* Takes a picture. Fails if its file does not have the format that the answer to “open” has
 * named. */
static Frame *take(struct bench *bench, gint64 exposure_us, double gain_db) {
    const struct camera_format *format = &bench->format;
    g_autoptr(GError) error = NULL;
    guint64 id;
    send_trigger(bench, exposure_us, gain_db, &id);
    const gint64 sent_us = bench->written_us;
    const struct bench_answer *answer = bench_await_any(
        bench, id, "“trigger”", (int)(program_camera_wait_us(format, exposure_us) / 1000));
    if (answer && answer->failure)
        bench_fail(bench, "see what the program has printed", "a picture", "the error “%s”",
                   answer->failure);
    const gboolean good = answer && answer->values &&
                          check_times(bench, answer->values, exposure_us, sent_us, answer->at_us);
    bench->exposure_us = 0;
    if (!good)
        return NULL;
    g_autofree char *name = message_text(answer->values, "file");
    g_autoptr(Frame) frame =
        pgm_take(bench->folder, name, format->width, format->height, format->bits, &error);
    if (!frame)
        bench_fail(bench,
                   "write the picture into the folder of “hello” before the answer, as a PGM file "
                   "(P5) of the size and bits of “open”",
                   "a picture that can be read", "the program %s", error->message);
    else if (frame->incomplete)
        bench_fail(bench, "close the file before the answer", "a picture with all its values",
                   "the file “%s” ends early", name);
    else
        return g_steal_pointer(&frame);
    return NULL;
}

static gboolean shoot(struct bench *bench, gint64 exposure_us, double gain_db) {
    g_autoptr(Frame) frame = take(bench, exposure_us, gain_db);
    return frame != NULL;
}

gboolean check_camera_trigger(struct bench *bench) {
    return bench_ready(bench) && shoot(bench, exposure(bench, FIRST_US), 0);
}

gboolean check_camera_pictures(struct bench *bench) {
    g_autoptr(Frame) before = NULL;
    if (!bench_ready(bench))
        return FALSE;
    for (int i = 0; i < 3; i++) {
        g_autoptr(Frame) frame = take(bench, exposure(bench, EXPOSURE_US), 0);
        if (!frame)
            return FALSE;
        if (before &&
            memcmp(before->pixels, frame->pixels,
                   (gsize)frame->width * (gsize)frame->height * sizeof *frame->pixels) == 0)
            return bench_fail(bench,
                              "answer with a new picture. If the camera looks at the dark without "
                              "noise, give it light",
                              "a picture that differs from the one before",
                              "picture %d equals picture %d bit for bit", i + 1, i);
        g_clear_pointer(&before, frame_unref);
        before = g_steal_pointer(&frame);
    }
    return TRUE;
}

gboolean check_camera_exposures(struct bench *bench) {
    if (!bench_ready(bench))
        return FALSE;
    const gint64 shortest_us = exposure(bench, 1), longer_us = exposure(bench, 20 * EXPOSURE_US);
    return shoot(bench, longer_us, 0) && shoot(bench, shortest_us, 0) && shoot(bench, longer_us, 0);
}

gboolean check_camera_gain(struct bench *bench) {
    if (!bench_ready(bench))
        return FALSE;
    if (!bench_can(bench, "gain"))
        return bench_skip(bench, "the answer to “hello” has no capability “gain”");
    return shoot(bench, exposure(bench, EXPOSURE_US), 6);
}

/* Checks “stop” during an exposure, and then takes another picture. */
gboolean check_camera_stop(struct bench *bench) {
    guint64 trigger, stop;
    if (!bench_ready(bench))
        return FALSE;
    if (!bench_can(bench, "stop"))
        return bench_skip(bench, "the answer to “hello” has no capability “stop”");
    const int wait_ms = PROGRAM_ANSWER_MS + (int)(bench->format.readout_us / 1000);
    const gint64 exposure_us = exposure(bench, STOPPED_US);
    send_trigger(bench, exposure_us, 0, &trigger);
    bench_pass(bench, (int)MIN(STOP_MS, exposure_us / 2000));
    g_autofree char *line = bench_line(bench, "stop", NULL, &stop);
    bench_write(bench, line);
    bench->exposure_us = 1; /* the exposure may now end early */
    if (!bench_await(bench, stop, "“stop” while “trigger” runs", wait_ms, NULL))
        return FALSE;
    const struct bench_answer *answer =
        bench_await_any(bench, trigger, "the “trigger” that was stopped", wait_ms);
    if (!answer)
        return FALSE;
    bench->exposure_us = 0;
    if (!answer->failure && exposure_us >= SHORT_US)
        return bench_fail(bench, "answer the “trigger” by an error, and forget its picture",
                          "an error of the “trigger” that was stopped", "a result");
    return shoot(bench, exposure(bench, EXPOSURE_US), 0);
}
