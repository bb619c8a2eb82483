/* What the generated table of kernels and the marshaller share. */
#include <stddef.h>
#include <stdint.h>

/* Arguments and results are arrays of numbers of eight bytes (see marshal.c).
   Gives 0; else what numba's calling convention calls a status. */
typedef int (*Run)(const int64_t *given, int64_t *result);

typedef struct {
    const char *kernel;  /* module and name */
    const char *key;     /* types of the arguments, as resample.engine.compiled.compiling.key_of names them */
    const char *sources; /* fingerprint of the files that it was compiled from, and their modules */
    const char *gives;   /* types of the results, likewise */
    int count;           /* of numbers that the arguments take */
    Run run;
    Run wide; /* the same for x86-64-v4, or NULL */
} Entry;

typedef struct {
    const char *pickled; /* what numba's status points at */
    size_t size;         /* bytes of it */
    const char *name;    /* of a class of exceptions of Python's */
    const char *message;
} Failure;

extern const Entry ENTRIES[]; /* sorted by kernel */
extern const int ENTRY_COUNT;
extern const Failure FAILURES[];
extern const int FAILURE_COUNT;
