#include "adaptive.h"

#include <string.h>

#include "base/data_error.h"
#include "base/plural.h"
#include "lamps.h"
#include "readers.h"
#include "rounds.h"
#include "sweeps.h"

struct choice { /* the result of a thread */
    struct sweeps_choice sweeps;
    struct lamps_choice lamps;
    GError *error;
};

struct Adaptive {
    struct adaptive_setup setup;
    Readers *readers;
    struct rounds of_sweeps, of_lamps; /* empty if the kind does not come in rounds */
    Sweeps *sweeps;                    /* NULL if sweeps do not come in rounds */
    Lamps *lamps;                      /* NULL if shots of lamps do not come in rounds */
    GThread *thread;                   /* the thread that makes a choice; NULL if there is none */
    struct choice *choice;             /* result of the thread */
    GSource *wake;                     /* ready when the result is there */
};

gboolean adaptive_is_wanted(const struct session_conf *conf) {
    return conf->laser_stop == STOP_COVERED || conf->light_sampling == SAMPLING_ADAPTIVE;
}

gboolean adaptive_is_chosen(const Adaptive *adaptive, const struct session_shot *shot) {
    return (!adaptive->sweeps || rounds_have(&adaptive->of_sweeps, shot)) &&
           (!adaptive->lamps || rounds_have(&adaptive->of_lamps, shot));
}

int adaptive_round_of(const Adaptive *adaptive, const struct session_shot *shot) {
    if (shot->kind == SHOT_SWEEP && adaptive->sweeps)
        return adaptive->of_sweeps.of[shot->id - 1];
    if (shot->kind == SHOT_LAMP && adaptive->lamps)
        return adaptive->of_lamps.of[shot->id - 1];
    return 1;
}

int adaptive_rounds(const Adaptive *adaptive) {
    return MAX(MAX(adaptive->of_sweeps.n, adaptive->of_lamps.n), 1);
}

static gboolean sweeps_are_over(const Adaptive *adaptive) {
    return !adaptive->sweeps || adaptive->of_sweeps.over;
}

static gboolean lamps_are_over(const Adaptive *adaptive) {
    return !adaptive->lamps || adaptive->of_lamps.over;
}

gboolean adaptive_is_over(const Adaptive *adaptive) {
    return sweeps_are_over(adaptive) && lamps_are_over(adaptive);
}

void adaptive_take(Adaptive *adaptive, const struct session_shot *shot,
                   const struct session_frame *frames, int n) {
    if (shot->kind == SHOT_SWEEP && !sweeps_are_over(adaptive))
        sweeps_take(adaptive->sweeps, shot, frames, n);
    if (shot->kind == SHOT_LAMP && !lamps_are_over(adaptive))
        lamps_take_shot(adaptive->lamps, shot, frames, n);
}

static void free_choice(struct choice *choice) {
    if (!choice)
        return;
    g_clear_pointer(&choice->sweeps.shots, g_array_unref);
    g_clear_pointer(&choice->lamps.shots, g_array_unref);
    g_clear_error(&choice->error);
    g_free(choice);
}

/* Makes the choices in a separate thread. Reads nothing that the main loop may change meanwhile. */
static gpointer work_out(gpointer data) {
    Adaptive *adaptive = data;
    struct choice *choice = g_new0(struct choice, 1);
    if (readers_wait(adaptive->readers, &choice->error)) {
        if (!sweeps_are_over(adaptive))
            choice->sweeps = sweeps_choose(adaptive->sweeps);
        if (!lamps_are_over(adaptive))
            lamps_choose(adaptive->lamps, &adaptive->of_lamps, &choice->lamps, &choice->error);
    }
    adaptive->choice = choice;
    g_source_set_ready_time(adaptive->wake, 0);
    return NULL;
}

static gboolean say(Adaptive *adaptive, const char *key, double pct, GError **error) {
    char text[G_ASCII_DTOSTR_BUF_SIZE];
    return session_set_value(adaptive->setup.session, key,
                             g_ascii_formatd(text, sizeof text, "%.3f", pct), error);
}

static gboolean leave_sweeps_out(Adaptive *adaptive, GError **error) {
    g_autofree char *note =
        g_strdup_printf(SESSION_LEFT_OUT " expected to add less than %g %% to what its views know",
                        adaptive->setup.conf->laser_gain_pct);
    return rounds_leave_out(&adaptive->of_sweeps, note, error);
}

/* Marks the remaining shots of lamps as skipped. Their note contains the stored value of the
 * expected error, so that the note is the same if the session was killed and resumed. */
static gboolean leave_lamps_out(Adaptive *adaptive, GError **error) {
    g_autofree char *pct = NULL;
    if (!session_read_value(adaptive->setup.session, ADAPTIVE_ERROR_PCT, &pct, error))
        return FALSE;
    g_autofree char *note =
        g_strdup_printf(SESSION_LEFT_OUT " its pictures are predicted from others, with an "
                                         "expected error of %s %% in all",
                        pct ? pct : "?");
    return rounds_leave_out(&adaptive->of_lamps, note, error);
}

/* Stores a choice of sweeps as the next round, or leaves the remaining sweeps out if the choice is
 * empty. ret_text describes the result; g_free(). */
static gboolean store_sweeps(Adaptive *adaptive, const struct sweeps_choice *choice,
                             char **ret_text, GError **error) {
    const int n = (int)choice->shots->len, rounds = adaptive->of_sweeps.n;
    g_autofree char *more = n > 0
                                ? g_strdup_printf("%d more %s may add to that", PLURAL(n, "sweep"))
                                : g_strdup("no further sweep is expected to add to that");
    *ret_text =
        g_strdup_printf("%.2f %% of what the cameras see of the reference plane is known "
                        "after %d %s of sweeps, %.1f %% in the worst view; %s",
                        choice->known_pct, PLURAL(rounds, "round"), choice->worst_pct, more);
    return say(adaptive, ADAPTIVE_KNOWN_PCT, choice->known_pct, error) &&
           say(adaptive, ADAPTIVE_WORST_PCT, choice->worst_pct, error) &&
           rounds_store(&adaptive->of_sweeps, choice->shots, error) &&
           (n > 0 || leave_sweeps_out(adaptive, error));
}

static char *tell_lamps(const struct session_conf *conf, const struct lamps_choice *choice) {
    const int n = (int)choice->shots->len;
    if (n > 0)
        return g_strdup_printf("%d more %s of lamps %s expected to lower it to %.2f %%",
                               PLURAL(n, "shot"), n == 1 ? "is" : "are", choice->after_pct);
    if (choice->end == LAMPS_KNOWN)
        return g_strdup_printf("error_pct = %g asks for no more", conf->light_error_pct);
    if (choice->end == LAMPS_BUDGET)
        return g_strdup_printf("budget_min = %g has no time for a further shot",
                               conf->light_budget_min);
    return g_strdup("no shot is left");
}

/* Stores a choice of shots of lamps as the next round, or leaves the remaining shots out if the
 * choice is empty. ret_text describes the result; g_free(). */
static gboolean store_lamps(Adaptive *adaptive, const struct lamps_choice *choice, char **ret_text,
                            GError **error) {
    g_autofree char *more = tell_lamps(adaptive->setup.conf, choice);
    const int rounds = adaptive->of_lamps.n;
    *ret_text = g_strdup_printf("%d of %d pictures of the BTF are taken after %d %s of lamps, and "
                                "the others can be predicted with an expected error of %.2f %% in "
                                "all; %s",
                                choice->n_taken, choice->n_pictures, PLURAL(rounds, "round"),
                                choice->error_pct, more);
    return say(adaptive, ADAPTIVE_ERROR_PCT, choice->error_pct, error) &&
           rounds_store(&adaptive->of_lamps, choice->shots, error) &&
           (choice->shots->len > 0 || leave_lamps_out(adaptive, error));
}

/* Records a frame with invalid content as damaged in the session. If the checksum of its file is
 * wrong, its shot is taken again when the session is resumed. */
static void note_damage(const char *frame, const GError *error, gpointer data) {
    Adaptive *adaptive = data;
    if (g_error_matches(error, DATA_ERROR, DATA_ERROR_INVALID))
        session_note_damage(adaptive->setup.session, frame, error->message, NULL);
}

static gboolean on_wake(gpointer data) {
    Adaptive *adaptive = data;
    Clock *clock = adaptive->setup.clock;
    g_autofree char *of_lasers = NULL, *of_lights = NULL;
    g_source_set_ready_time(adaptive->wake, -1);
    if (!adaptive->thread)
        return G_SOURCE_CONTINUE;
    g_thread_join(g_steal_pointer(&adaptive->thread));
    struct choice *choice = g_steal_pointer(&adaptive->choice);
    const struct sweeps_choice *sweeps = choice->sweeps.shots ? &choice->sweeps : NULL;
    const struct lamps_choice *lamps = choice->lamps.shots ? &choice->lamps : NULL;
    g_autoptr(GError) error = g_steal_pointer(&choice->error);
    readers_each_failed(adaptive->readers, note_damage, adaptive);
    const gboolean good = !error &&
                          (!sweeps || store_sweeps(adaptive, sweeps, &of_lasers, &error)) &&
                          (!lamps || store_lamps(adaptive, lamps, &of_lights, &error));
    const guint n = good ? (sweeps ? sweeps->shots->len : 0) + (lamps ? lamps->shots->len : 0) : 0;
    /* The hook may free the object. */
    adaptive->setup.hooks.chosen((int)n, of_lasers, of_lights, error, adaptive->setup.hooks.data);
    clock_release(clock);
    free_choice(choice);
    return G_SOURCE_CONTINUE;
}

static gboolean dispatch(GSource *source, GSourceFunc func, gpointer data) {
    return func(data);
}

void adaptive_choose(Adaptive *adaptive) {
    g_autoptr(GError) error = NULL;
    g_return_if_fail(!adaptive->thread && !adaptive_is_over(adaptive));
    if (!sweeps_are_over(adaptive))
        sweeps_note_done(adaptive->sweeps);
    clock_hold(adaptive->setup.clock);
    readers_retry(adaptive->readers);
    if (!lamps_are_over(adaptive) && !lamps_note_done(adaptive->lamps, &error)) {
        Clock *clock = adaptive->setup.clock;
        adaptive->setup.hooks.chosen(0, NULL, NULL, error, adaptive->setup.hooks.data);
        clock_release(clock);
        return;
    }
    adaptive->thread = g_thread_new("choice", work_out, adaptive);
}

char *adaptive_first_round(const struct session_conf *conf, const struct plan *plan,
                           enum session_shot_kind kind) {
    g_autoptr(GArray) chosen = g_array_new(FALSE, FALSE, sizeof(int));
    if (kind == SHOT_SWEEP ? conf->laser_stop != STOP_COVERED
                           : conf->light_sampling != SAMPLING_ADAPTIVE)
        return NULL;
    for (int i = 0; i < plan->n_first; i++)
        if (plan->session.shots[i].kind == kind && plan->session.shots[i].state != SHOT_SKIPPED)
            g_array_append_val(chosen, i);
    return rounds_to_text(chosen);
}

static gboolean load_rounds(struct rounds *rounds, GError **error) {
    if (!rounds_load(rounds, error))
        return FALSE;
    return rounds->n > 0 ||
           data_error_fail(
               session_path(rounds->session), 0, error,
               "the session's value %s1, which names the shots of the first round, is missing; "
               "begin a new session",
               rounds->key);
}

/* Examines the frames that earlier runs have stored. */
static gboolean take_done(Adaptive *adaptive, GError **error) {
    g_autoptr(GPtrArray) frames = session_frames(adaptive->setup.session, error);
    if (!frames)
        return FALSE;
    for (guint i = 0; i < frames->len; i++) {
        const struct session_frame *frame = frames->pdata[i];
        const struct session_shot *shot = adaptive->setup.shots->pdata[frame->shot - 1];
        if (shot->state == SHOT_DONE)
            adaptive_take(adaptive, shot, frame, 1);
    }
    return TRUE;
}

static gboolean load(Adaptive *adaptive, GError **error) {
    if ((adaptive->sweeps && !load_rounds(&adaptive->of_sweeps, error)) ||
        (adaptive->lamps && !load_rounds(&adaptive->of_lamps, error)))
        return FALSE;
    return (!adaptive->sweeps || !adaptive->of_sweeps.over || leave_sweeps_out(adaptive, error)) &&
           (!adaptive->lamps || !adaptive->of_lamps.over || leave_lamps_out(adaptive, error)) &&
           (adaptive_is_over(adaptive) || take_done(adaptive, error));
}

Adaptive *adaptive_new(const struct adaptive_setup *setup, GError **error) {
    static GSourceFuncs funcs = {.dispatch = dispatch};
    Adaptive *adaptive = g_new0(Adaptive, 1);
    adaptive->setup = *setup;
    adaptive->readers = readers_new(setup->clock);
    rounds_init(&adaptive->of_sweeps, setup->session, setup->shots, SHOT_SWEEP,
                ADAPTIVE_LASER_ROUNDS);
    rounds_init(&adaptive->of_lamps, setup->session, setup->shots, SHOT_LAMP,
                ADAPTIVE_LIGHT_ROUNDS);
    adaptive->wake = g_source_new(&funcs, sizeof(GSource));
    g_source_set_callback(adaptive->wake, on_wake, adaptive, NULL);
    g_source_attach(adaptive->wake, NULL);
    if (setup->conf->laser_stop == STOP_COVERED)
        adaptive->sweeps = sweeps_new(setup->session, setup->conf, setup->shots,
                                      &setup->calibration->rig, adaptive->readers);
    const struct lamps_setup of_lamps = {.session = setup->session,
                                         .conf = setup->conf,
                                         .shots = setup->shots,
                                         .calibration = setup->calibration,
                                         .nominal = setup->nominal,
                                         .timing = setup->timing,
                                         .readers = adaptive->readers};
    if ((setup->conf->light_sampling == SAMPLING_ADAPTIVE &&
         !(adaptive->lamps = lamps_new(&of_lamps, error))) ||
        !load(adaptive, error))
        g_clear_pointer(&adaptive, adaptive_free);
    return adaptive;
}

void adaptive_free(Adaptive *adaptive) {
    if (!adaptive)
        return;
    readers_stop(adaptive->readers);
    if (adaptive->lamps)
        lamps_stop(adaptive->lamps);
    if (adaptive->thread) {
        g_thread_join(adaptive->thread);
        clock_release(adaptive->setup.clock);
    }
    readers_free(adaptive->readers);
    free_choice(adaptive->choice);
    g_source_destroy(adaptive->wake);
    g_source_unref(adaptive->wake);
    sweeps_free(adaptive->sweeps);
    lamps_dispose(adaptive->lamps);
    rounds_clear(&adaptive->of_sweeps);
    rounds_clear(&adaptive->of_lamps);
    g_free(adaptive);
}
