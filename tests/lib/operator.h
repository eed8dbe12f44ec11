/*
 * An operator of the small simulated rig, who runs mesorig's commands and reads what they say, for
 * tests of what he is told. Everything is made below one temporary folder, which operator_tests()
 * removes. What goes wrong in here fails the test.
 */
#pragma once

#include "process.h"
#include "small_rig.h"

struct operation {
    char *directory, *rig, *conf, *session;
    char *out, *err; /* of the last command */
};

/* Runs what was added with g_test_add_func(); main()'s result. */
int operator_tests(void);
const char *operator_folder(void);

struct operation *operator_new(const struct change *rig_changes);
struct operation *operator_new_in(const char *parent, const struct change *rig_changes);
void operator_free(struct operation *run);

/* Runs mesorig with arguments up to NULL, and asks for its exit code. */
void operator_does(struct operation *run, int code, ...) G_GNUC_NULL_TERMINATED;
void operator_captures(struct operation *run, int code);

/* Every product's name and checksum, a line each; the caller's. */
char *operator_products(const char *session);
/* The products of a session that nothing happens to. */
const char *operator_undisturbed(void);
/* Processes the session and compares its products with those. */
void operator_check_products(struct operation *run);
/* What the database has of the frames, a line each; the caller's. */
char *operator_frames(const char *path);
