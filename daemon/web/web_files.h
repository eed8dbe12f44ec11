/*
 * The tasks of session files and session directories (web_task.h). All of them are in one folder,
 * which the option --sessions names: the session file of the name "weave" is FOLDER/weave.conf, and
 * the session directory of that name is FOLDER/weave.session. A name is one part of a path, does
 * not begin with a period, and is never a symbolic link. No request can therefore name a file
 * outside the folder. mesorigd checks the rights, and makes the directories.
 */
#pragma once

#include "web_task.h"

#define WEB_FILES_MAX_BYTES (256 << 10) /* maximum size of a session file */
#define WEB_FILES_MAX       200         /* maximum number of files or directories in a list */

/* Returns whether a client may use this name: UTF-8 of 1 to 100 bytes, no slash, no control
 * character, no period at the beginning. */
gboolean web_files_is_name(const char *name);

/* Returns FOLDER/NAME.session if it is a directory and no link; g_free(). Otherwise answers the
 * task and returns NULL. */
char *web_files_directory(const struct web_task *task);

/* {"folder": true, "files": [{"name", "bytes", "changed"}, …]}. A file is listed if it has the
 * line [session]. */
void web_files_list(const struct web_task *task);
/* {"folder": true, "sessions": [{"name", "changed"}, …]} */
void web_files_sessions(const struct web_task *task);

/* Plan, start or queue a session file. The query may have the name of the session (session=weave2;
 * by default that of the file) and, except for a plan, process=1. queue also has yes=1. */
void web_files_plan(const struct web_task *task);
void web_files_start(const struct web_task *task);
void web_files_queue(const struct web_task *task);
void web_files_resume(const struct web_task *task);
