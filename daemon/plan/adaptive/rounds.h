/*
 * The rounds in which shots of one kind are taken. A round is stored in the session before it takes
 * effect. The session's values KEY1, KEY2, … (“lasers.round.1” for the key “lasers.round.”) contain
 * the ids of the shots that join in a round, separated by spaces. After a round without shots there
 * is no further round. All functions belong to the main loop's thread.
 */
#pragma once

#include "session/session.h"

struct rounds {
    Session *session; /* borrowed, like the shots */
    const GPtrArray *shots;
    enum session_shot_kind kind;
    const char *key; /* "lasers.round." */
    int *of;         /* for each shot: number of its round, from 1; 0 if it is in no round */
    int n;
    gboolean over; /* whether the last round is stored */
};

void rounds_init(struct rounds *rounds, Session *session, const GPtrArray *shots,
                 enum session_shot_kind kind, const char *key);
void rounds_clear(struct rounds *rounds);

/* Reads the rounds that are stored. Returns FALSE with an error if a value cannot be read or is not
 * as described above. */
gboolean rounds_load(struct rounds *rounds, GError **error);

/* Returns the value that stores a round; g_free(). shots contains int: indices of shots. */
char *rounds_to_text(const GArray *shots);

/* Stores the next round. shots contains int: indices of shots. An empty round is the last one. */
gboolean rounds_store(struct rounds *rounds, const GArray *shots, GError **error);

/* Returns whether a shot is in a round, or is of another kind. */
static inline gboolean rounds_have(const struct rounds *rounds, const struct session_shot *shot) {
    return shot->kind != rounds->kind || rounds->of[shot->id - 1] != 0;
}

/* Marks the shots that are in no round as skipped, with a note. If the daemon was killed during an
 * earlier call, some may already be marked. */
gboolean rounds_leave_out(struct rounds *rounds, const char *note, GError **error);
