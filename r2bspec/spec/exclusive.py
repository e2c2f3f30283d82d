def exclusive_errors(tree):
    return []
