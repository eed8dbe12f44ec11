/*
 * A set of cameras of a rig. A camera on the camera arm counts as a separate camera at each stop of
 * the arm (geometry/rig.h). A set is plain data: the initialiser {0} makes an empty set, and an
 * assignment copies a set. Any thread may call the functions.
 *
 *     struct camera_set shown = camera_set_of(3);
 *     camera_set_add(&shown, 70);
 *     for (int c = camera_set_next(shown, -1); c >= 0; c = camera_set_next(shown, c))
 *         ... c is 3, then 70
 */
#pragma once

#include <glib.h>

#define CAMERA_SET_MAX 256 /* the cameras 0 … CAMERA_SET_MAX − 1 can be in a set */

#define CAMERA_SET_WORD_BITS 64
#define CAMERA_SET_WORDS     (CAMERA_SET_MAX / CAMERA_SET_WORD_BITS)

struct camera_set {
    /* bit c % 64 of word c / 64 is set if camera c is in the set */
    guint64 words[CAMERA_SET_WORDS];
};

/* Returns a word in which only the bit of this camera is set. */
static inline guint64 camera_set_bit(int camera) {
    return (guint64)1 << camera % CAMERA_SET_WORD_BITS;
}

/* Returns whether a camera is in a set. Returns FALSE for a number that no set can contain, such as
 * −1 or CAMERA_SET_MAX. */
static inline gboolean camera_set_has(struct camera_set set, int camera) {
    return camera >= 0 && camera < CAMERA_SET_MAX &&
           (set.words[camera / CAMERA_SET_WORD_BITS] & camera_set_bit(camera)) != 0;
}
/* Returns whether a set is empty. */
static inline gboolean camera_set_is_empty(struct camera_set set) {
    guint64 any = 0;
    for (int i = 0; i < CAMERA_SET_WORDS; i++)
        any |= set.words[i];
    return any == 0;
}
/* Returns whether two sets contain the same cameras. */
static inline gboolean camera_set_equal(struct camera_set a, struct camera_set b) {
    guint64 differs = 0;
    for (int i = 0; i < CAMERA_SET_WORDS; i++)
        differs |= a.words[i] ^ b.words[i];
    return differs == 0;
}

/* Adds a camera to a set. camera must be 0 … CAMERA_SET_MAX − 1. */
static inline void camera_set_add(struct camera_set *set, int camera) {
    set->words[camera / CAMERA_SET_WORD_BITS] |= camera_set_bit(camera);
}
/* Removes a camera from a set. camera must be 0 … CAMERA_SET_MAX − 1. */
static inline void camera_set_remove(struct camera_set *set, int camera) {
    set->words[camera / CAMERA_SET_WORD_BITS] &= ~camera_set_bit(camera);
}

/* Returns the set that contains only this camera, 0 … CAMERA_SET_MAX − 1. */
static inline struct camera_set camera_set_of(int camera) {
    struct camera_set set = {{0}};
    camera_set_add(&set, camera);
    return set;
}

/* Returns the cameras that are in a, in b, or in both sets. */
static inline struct camera_set camera_set_union(struct camera_set a, struct camera_set b) {
    for (int i = 0; i < CAMERA_SET_WORDS; i++)
        a.words[i] |= b.words[i];
    return a;
}
/* Returns the cameras that are in both sets. */
static inline struct camera_set camera_set_both(struct camera_set a, struct camera_set b) {
    for (int i = 0; i < CAMERA_SET_WORDS; i++)
        a.words[i] &= b.words[i];
    return a;
}
/* Returns the cameras of a that are not in b. */
static inline struct camera_set camera_set_without(struct camera_set a, struct camera_set b) {
    for (int i = 0; i < CAMERA_SET_WORDS; i++)
        a.words[i] &= ~b.words[i];
    return a;
}

/* Returns the number of cameras in a set. */
static inline int camera_set_count(struct camera_set set) {
    int n = 0;
    for (int i = 0; i < CAMERA_SET_WORDS; i++)
        n += __builtin_popcountll(set.words[i]);
    return n;
}

/* Compares sets, for sorting. The highest camera that only one of the two sets contains decides:
 * the set that contains this camera is the greater one. Returns −1 if a is less than b, 0 if they
 * are equal, and 1 if a is greater. */
static inline int camera_set_compare(struct camera_set a, struct camera_set b) {
    for (int i = CAMERA_SET_WORDS - 1; i >= 0; i--)
        if (a.words[i] != b.words[i])
            return a.words[i] < b.words[i] ? -1 : 1;
    return 0;
}

/* Returns the lowest camera of a set above `after`, or −1 if there is none. If `after` is −1, the
 * result is the lowest camera of the set. */
static inline int camera_set_next(struct camera_set set, int after) {
    const int first = after + 1;
    for (int i = first / CAMERA_SET_WORD_BITS; i < CAMERA_SET_WORDS; i++) {
        const int from = MAX(first - i * CAMERA_SET_WORD_BITS, 0);
        const guint64 left = set.words[i] >> from;
        if (left != 0)
            return i * CAMERA_SET_WORD_BITS + from + __builtin_ctzll(left);
    }
    return -1;
}

/* Returns the numbers of the cameras in ascending order, such as "0 3 70". Returns "" for the empty
 * set. Free the result with g_free(). */
char *camera_set_to_text(struct camera_set set);
/* Reads the text of camera_set_to_text(). Returns FALSE and does not change ret if the text is not
 * such a text, for instance if a number is out of range, is given twice, or is out of order. */
gboolean camera_set_from_text(const char *text, struct camera_set *ret);
