/*
 * The tasks of session files and session directories (web_task.h). All of them are in one folder,
 * which the option --sessions names: the session file of the name "weave" is FOLDER/weave.conf, and
 * the session directory of that name is FOLDER/weave.session. A name is one part of a path, does
 * not begin with a period, and is never a symbolic link. No request can therefore name a file
 * outside the folder. mesorigd checks the rights, and makes the directories.
 */
#pragma once

#include "web_task.h"

#include <sys/stat.h>

#define WEB_FILES_MAX_BYTES   (256 << 10) /* maximum size of a session file */
#define WEB_FILES_MAX         200         /* maximum number of files or directories in a list */
#define WEB_FILES_CALIBRATION ".calibration"

/* Returns whether a client may use this name: UTF-8 of 1 to 100 bytes, no slash, no control
 * character, no period at the beginning. */
gboolean web_files_is_name(const char *name);

/* Returns whether there is a folder and the name is allowed. If not, answers the task. */
gboolean web_files_check(const struct web_task *task, const char *name);

/* Returns the path of a file in the folder: FOLDER/NAME and the ending; g_free(). */
char *web_files_path(const struct web_task *task, const char *name, const char *ending);

/* Returns the sorted names of the files and directories in the folder that have this ending. The
 * names do not include the ending. The list is empty if the server has no folder. Free it with
 * g_ptr_array_unref(). */
GPtrArray *web_files_names(const struct web_task *task, const char *ending);

/* Returns the text of a file of at most `most` bytes; g_free(). *ret_info is the status of the
 * file. Returns NULL with errno if the file cannot be read, is a link or no regular file, is too
 * large, or is not UTF-8. A FIFO does not block. */
char *web_files_read(const char *path, gsize most, struct stat *ret_info);

/* Adds an entry {"name", "bytes", "changed"} for each file FOLDER/NAME.conf that has this section,
 * such as "[session]". */
void web_files_add_section(const struct web_task *task, const char *section,
                           GVariantBuilder *entries);

/* Adds an entry to a list for each of the first WEB_FILES_MAX names. If type is S_IFREG, the entry
 * is {"name", "bytes", "changed"}; if it is S_IFDIR, the entry is {"name", "changed"}. A name is
 * left out if FOLDER/NAME and the ending is not of this type. */
void web_files_add(const struct web_task *task, const GPtrArray *names, const char *ending,
                   mode_t type, GVariantBuilder *entries);

/* Returns FOLDER/NAME.session; g_free(). If this is not a directory, or is a link, answers the task
 * and returns NULL. */
char *web_files_directory(const struct web_task *task, const char *name);

/* Answers {"folder": true, "files": [{"name", "bytes", "changed"}, …]}. A file is listed if it has
 * the line [session]. */
void web_files_list(const struct web_task *task);
/* Answers {"folder": true, "sessions": [{"name", "changed"}, …]}. */
void web_files_sessions(const struct web_task *task);

/* Plan, start or queue a session file. The query may name the session (session=weave2; by default
 * it has the name of the file) and a calibration that replaces the one of the rig file
 * (calibration=rig2). To start or queue a session, it may have process=1. To queue a session, it
 * may have yes=1: test shots that give warnings do not stop the session. */
void web_files_plan(const struct web_task *task);
void web_files_start(const struct web_task *task);
void web_files_queue(const struct web_task *task);
/* Resumes the session directory of the task's name. The query may have process=1. */
void web_files_resume(const struct web_task *task);
