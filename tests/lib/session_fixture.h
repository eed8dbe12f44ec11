/*
 * Sessions with random plans, for the tests of sessions. All files are made below one temporary
 * folder, which session_fixture_run() removes.
 */
#pragma once

#include "exr/exr.h"
#include "session/session.h"

#include "remove_tree.h"

#include <errno.h>
#include <fcntl.h>
#include <glib/gstdio.h>
#include <math.h>
#include <sched.h>
#include <signal.h>
#include <sqlite3.h>
#include <string.h>
#include <sys/mount.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

extern char *session_fixture_folder;

char *session_fixture_path(const char *name);
char *session_fixture_new_folder(void); /* makes an empty folder in that folder */

struct random_plan {
    struct session_plan plan;
    struct session_direction views[40], lights[40], lasers[40];
    struct session_shot shots[300];
};

static const struct session_texts texts = {
    .rig_conf = "[rig]\nname = Prüfstand\n",
    .session_conf = "[session]\n",
    .calibration = "",
    .rig_path = "/etc/mesorig/rig.conf",
};

struct random_plan *session_fixture_random_plan(guint32 seed, int n_shots);
Session *session_fixture_create(const char *path, guint32 seed, int n_shots);

#define assert_bits(a, b) g_assert_cmpmem(&(a), sizeof(double), &(b), sizeof(double))

void session_fixture_assert_plan(Session *session, const struct random_plan *p);
struct session_frame session_fixture_frame(Session *session, gint64 shot, int camera);
void session_fixture_clear_frame(struct session_frame *frame);
gboolean session_fixture_commit(Session *session, gint64 shot, int n, GError **error);
enum session_shot_state session_fixture_state(Session *session, gint64 shot);
void session_fixture_wait(pid_t child, int signal);
int session_fixture_run(void);
