/*
 * Sessions of the small simulated rig, captured from beginning to end in one process, for the tests
 * of captures. All files are made below one temporary folder, which run_tests() removes. Errors in
 * these functions fail the test.
 */
#pragma once

#include "capture/capture.h"
#include "small_rig.h"

struct run {
    char *directory; /* folder of this test */
    char *session;
    struct devices *devices;
    struct session_conf conf;
    Capture *capture;
    GString *told; /* events, one per line */
    int n_told, n_changed;
    gint64 changed_us, least_gap_us;
};

/* Runs the tests that were added with g_test_add_func(). Returns the exit code for main(). */
int run_tests(void);

struct run *run_new(const struct change *changes); /* changes may be NULL */
void run_free(struct run *run);
void run_open_devices(struct run *run);
/* Replaces the rig by one with other changes, and opens its devices again. */
void run_change_rig(struct run *run, const struct change *changes);

void run_start(struct run *run);
struct run *run_begin(const struct change *changes); /* calls run_new() and run_start() */
/* run_resume() frees the capture, and continues its session as after a crash (capture_resume()).
 * run_continue() continues a paused capture (capture_continue()). */
void run_resume(struct run *run);
void run_continue(struct run *run);
struct capture_status run_status(struct run *run);
/* Runs the main loop until the capture has stopped or has taken this number of frames. With frames
 * = 0, only the first condition counts. */
enum capture_state run_until(struct run *run, gint64 frames);
void run_to_end(struct run *run); /* also frees the capture */
void run_to_pause(struct run *run, const char *reason);
void run_pass_time(struct run *run, int seconds);

/* Checks that all lamps and lasers are off and that the axes stand still. */
void run_check_safe(struct run *run);
/* Return an array of struct session_frame or session_shot, which the caller owns. */
GPtrArray *run_frames(const char *session_path);
GPtrArray *run_shots(const char *session_path);
/* Returns the path of a session that was captured without faults; it is made once. */
const char *run_undisturbed(void);
/* Checks that an EXR file of a session is the same in another session, bit for bit. relative is its
 * path in both sessions. */
void run_check_same_file(const char *expected_path, const char *session_path, const char *relative);
/* Checks that a session has the same frames as another session, bit for bit. */
void run_check_same_frames(const char *expected_path, const char *session_path);
/* Checks that all frames exist and are bit-identical to those of a capture without faults. */
void run_check_same(struct run *run);
/* Checks that the session is done and that every frame of a done shot exists. */
void run_check_whole(const char *path);
/* Calls run_to_end(), run_check_whole() and run_check_same(), and frees the run. */
void run_finish(struct run *run);
