/*
 * Which shots of one kind are taken in which round: stored in the session before anything is acted
 * upon. The session's values KEY.1, KEY.2, … (“lasers.round.1”) hold the shots that joined in a
 * round, as numbers with spaces between them; one without any is the last. Main loop's thread.
 */
#pragma once

#include "session/session.h"

struct rounds {
    Session *session; /* borrowed, as the shots */
    const GPtrArray *shots;
    enum session_shot_kind kind;
    const char *key; /* "lasers.round." */
    int *of;         /* of each shot: its round, from 1; 0: none */
    int n;
    gboolean over; /* the last one is stored */
};

void rounds_init(struct rounds *rounds, Session *session, const GPtrArray *shots,
                 enum session_shot_kind kind, const char *key);
void rounds_clear(struct rounds *rounds);

/* Reads those that are stored. FALSE: a value cannot be read, or is not as described above. */
gboolean rounds_load(struct rounds *rounds, GError **error);

/* The value that stores a round: shots are numbers from 0, of int. g_free() */
char *rounds_to_text(const GArray *shots);

/* Stores a further round: numbers of shots, from 0, of int; none: it is the last. */
gboolean rounds_store(struct rounds *rounds, const GArray *shots, GError **error);

static inline gboolean rounds_have(const struct rounds *rounds, const struct session_shot *shot) {
    return shot->kind != rounds->kind || rounds->of[shot->id - 1] != 0;
}

/* Marks the shots of no round as skipped. Some may have been before a kill. */
gboolean rounds_leave_out(struct rounds *rounds, const char *note, GError **error);
