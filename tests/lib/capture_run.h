/*
 * Sessions of the small simulated rig, captured from beginning to end in one process, for the tests
 * of captures. Everything is made below one temporary folder, which run_tests() removes. What goes
 * wrong in here fails the test.
 */
#pragma once

#include "capture/capture.h"
#include "small_rig.h"

struct run {
    char *directory; /* of this test */
    char *session;
    struct devices *devices;
    struct session_conf conf;
    Capture *capture;
    GString *told; /* events, a line each */
    int n_told, n_changed;
    gint64 changed_us, least_gap_us;
};

/* Runs what was added with g_test_add_func(); main()'s result. */
int run_tests(void);

struct run *run_new(const struct change *changes); /* or NULL: nothing */
void run_free(struct run *run);
void run_open_devices(struct run *run);
/* The rig with other changes, its devices opened anew. */
void run_change_rig(struct run *run, const struct change *changes);

void run_start(struct run *run);
struct run *run_begin(const struct change *changes); /* both */
void run_resume(struct run *run);
void run_continue(struct run *run);
struct capture_status run_status(struct run *run);
/* Until it rests, or has taken that many frames (0: any number). */
enum capture_state run_until(struct run *run, gint64 frames);
void run_to_end(struct run *run); /* and frees the capture */
void run_to_pause(struct run *run, const char *reason);
void run_pass_time(struct run *run, int seconds);

/* All lamps and lasers are off, the axes stand. */
void run_check_safe(struct run *run);
/* Of struct session_frame or session_shot, the caller's. */
GPtrArray *run_frames(const char *session_path);
GPtrArray *run_shots(const char *session_path);
/* The path of a session that nothing happened to, made once. */
const char *run_undisturbed(void);
/* Every frame is there and is, to the bit, what it should be. */
void run_check_same(struct run *run);
/* The session is done, and every frame of a done shot is there. */
void run_check_whole(const char *path);
/* To the end, with both of these checks, and frees the run. */
void run_finish(struct run *run);
