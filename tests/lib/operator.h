/*
 * An operator of the small simulated rig, who runs the commands of mesorig and reads their output,
 * for tests of this output. All files are made below one temporary folder, which operator_tests()
 * removes. Errors in these functions fail the test.
 */
#pragma once

#include "process.h"
#include "small_rig.h"

struct operation {
    char *directory, *rig, *conf, *session;
    char *out, *err; /* output of the last command */
};

/* Runs the tests that were added with g_test_add_func(). Returns the exit code for main(). */
int operator_tests(void);
const char *operator_folder(void);

struct operation *operator_new(const struct change *rig_changes);
struct operation *operator_new_in(const char *parent, const struct change *rig_changes);
void operator_free(struct operation *run);

/* Runs mesorig with arguments that end with NULL, and checks its exit code. */
void operator_does(struct operation *run, int code, ...) G_GNUC_NULL_TERMINATED;
void operator_captures(struct operation *run, int code);

/* Returns the name and checksum of every product, one product per line; g_free(). */
char *operator_products(const char *session);
/* Returns the products of a session that was captured and processed without faults. */
const char *operator_undisturbed(void);
/* Processes the session and checks that its products are the same as operator_undisturbed(). */
void operator_check_products(struct operation *run);
/* Returns the data of all frames in the database, one frame per line; g_free(). */
char *operator_frames(const char *path);

/* Returns all properties of the daemon at an address, as a{sv}; g_variant_unref(). Tests that wait
 * for the daemon call this instead of “mesorig status”, which costs far more. */
GVariant *operator_properties(const char *address);
