import re

from uav_collect import errors


def test_the_tree_in_the_docstring_is_that_of_the_classes() -> None:
    drawn, above = {}, [errors.UavCollectError.__name__]
    for indent, name in re.findall(r'^((?:  )+)[x+] (\w+)', errors.__doc__ or '', re.MULTILINE):
        depth = len(indent) // 2
        above[depth:] = [name]
        drawn[name] = above[depth - 1]
    classes = [
        each
        for each in vars(errors).values()
        if isinstance(each, type) and issubclass(each, Exception)
    ]
    assert drawn == {each.__name__: each.__base__.__name__ for each in classes[1:]}
