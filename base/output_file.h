/*
 * Output files: what happens to a file whose name a user has given, decided in one place for all
 * programs.
 *
 * - A name that nothing has is taken. If another program makes a file of that name meanwhile, that
 *   file stays.
 * - An existing file is refused, unless --force is given.
 * - A file that Mesorig itself wrote as the same kind of product may be replaced, and the program
 *   says so (output_file_note()).
 * - A character device or a pipe is written to. A folder, a socket and a disk (block device) are
 *   refused. None of them is ever replaced.
 * - A symbolic link is followed, and stays.
 *
 * Programs decide before they work: output_file_new() refuses, output_file_end() delivers. A file
 * is written in a folder of its own beside its place, NAME.XXXXXXXX.part, and renamed when it is
 * complete. If it cannot be renamed, it stays beside its place and the error names it.
 *
 * A file is of a kind if it holds "mesorig.kind" and the kind: as an attribute of an EXR, as a text
 * chunk of a PNG, as "mesorig.kind: KIND" in a comment of an HTML, SVG, PDF or PLY file or of a
 * text. Other formats have no room for it: their kind is NULL, and an existing file is always
 * refused without --force. Any thread.
 */
#pragma once

#include <gio/gio.h>

typedef struct OutputFile OutputFile;

/* Decides what becomes of path. kind: a word for the product ("report"), or NULL. NULL: the error
 * is DATA_ERROR_EXISTS or DATA_ERROR_IO and names path; nothing has been changed. */
OutputFile *output_file_new(const char *path, const char *kind, gboolean force, GError **error);

/* The same, and keeps other programs that ask so from writing the file until output_file_free():
 * G_IO_ERROR_BUSY (file_lock.h). Removes the unfinished files that killed writers left. */
OutputFile *output_file_new_locked(const char *path, const char *kind, gboolean force,
                                   GError **error);

/* Removes what was written, unless output_file_end() has delivered it. NULL is ignored. */
void output_file_free(OutputFile *file);
G_DEFINE_AUTOPTR_CLEANUP_FUNC(OutputFile, output_file_free)

/* The decision of output_file_new() alone. */
gboolean output_file_check(const char *path, const char *kind, gboolean force, GError **error);

/* The path to which the caller writes; nothing has that name, and its last part is that of the
 * output. Belongs to file. NULL: the folder for it cannot be made. */
const char *output_file_path(OutputFile *file, GError **error);

/* Delivers what the caller has written to output_file_path(). written FALSE: the caller failed with
 * *error; the file is removed, and the error names the output instead of that path. Returns
 * whether the output is complete. Adds the kind to PNG, SVG, PDF and HTML; writers of other formats
 * do that themselves. */
gboolean output_file_end(OutputFile *file, gboolean written, GError **error);

/* Writes and delivers n bytes. */
gboolean output_file_put(OutputFile *file, const void *bytes, gsize n, GError **error);

/* What happened to the file that was there, as a line for people without its end; NULL: there was
 * none. Belongs to file. */
const char *output_file_note(const OutputFile *file);
/* The note of a program that is no command of mesorig, to stderr: "PROGRAM: NOTE". */
void output_file_say(const OutputFile *file, const char *program);

gboolean output_file_streams(const OutputFile *file); /* to a device or pipe */

/* For a comment in a text: its kind, which is a string constant. A blank, a line's end or a
 * quotation mark follows. */
#define OUTPUT_FILE_TEXT(kind) "mesorig.kind: " kind

/* Renames without ever replacing something, not even an empty folder. Where the file system cannot
 * do that in one step (FUSE, NFS), a file of that name that another program makes in the very same
 * moment may be lost only if the file system lacks hard links as well. FALSE: errno, EEXIST if to
 * exists. */
gboolean output_file_move(const char *from, const char *to);

/* Moves a finished folder to its path, where nothing may be. FALSE: it stays beside that path, and
 * the error, DATA_ERROR_EXISTS or DATA_ERROR_IO, says where. */
gboolean output_file_move_folder(const char *folder, const char *path, GError **error);

/* Writes a file whose name Mesorig has chosen, or that of output_file_path(): it appears under its
 * name when all of it is on disk, and replaces an existing file. Errors, DATA_ERROR_IO, name the
 * file. */
gboolean output_file_write(const char *path, const void *bytes, gsize n, GError **error);
