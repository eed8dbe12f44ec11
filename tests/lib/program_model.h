/* The program tests/drivers/program/model.py and its device, for tests of the drivers of programs.
 * The device is a file in a folder, and it stays as it is when the program ends. Errors in these
 * functions fail the test. */
#pragma once

#include "conformance/conformance.h"

#define PROGRAM_PYTHON "/usr/bin/python3"
#define PROGRAM_MODEL  SOURCE_DIR "/tests/drivers/program/model.py"

/* Returns a section of this class, with more keys. start_s is the time that the program has to
 * start. Free it with g_free(). */
char *program_model_section(const char *class_name, const char *folder, int start_s,
                            const char *keys);

/* Sets the fault of the program; "" ends it. */
void program_model_fail(const char *folder, const char *fault);

/* The same as the function fail of struct conformance, with the folder as its data. */
void program_model_conformance_fail(gpointer folder, enum conformance_fault fault);

/* Returns a file of the folder, or "" if it is not there. Free it with g_free(). */
char *program_model_read(const char *folder, const char *name);

/* Returns the number of requests with this method that the program has received. */
int program_model_asked(const char *folder, const char *method);

/* Returns the number of processes of the program, and of those that watch it. */
int program_model_processes(const char *folder);

/* Kills the program that received the last request. */
void program_model_kill(const char *folder);
