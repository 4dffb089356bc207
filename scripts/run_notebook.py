# SPDX-License-Identifier: Apache-2.0
"""
Run a notebook and store the output of its cells, without Jupyter.

    .venv/bin/python scripts/run_notebook.py examples/paper.ipynb

The cells run as parts of one program. Printed output is stored as text, and the value of the last
expression as a picture if it is a figure, otherwise as its representation.
"""
import ast
import base64
from contextlib import redirect_stdout
import io
import json

from stages import path_argument

DOTS_PER_INCH = 80


def run_cells(cells):
    """Run the code cells in order; yield each with its new outputs."""
    names = {'__name__': '__main__'}
    for number, cell in enumerate((cell for cell in cells if cell['cell_type'] == 'code'), 1):
        printed = io.StringIO()
        with redirect_stdout(printed):
            value = run_cell(''.join(cell['source']), names)
        outputs = []
        if printed.getvalue():
            outputs.append({'name': 'stdout', 'output_type': 'stream',
                            'text': printed.getvalue().splitlines(keepends=True)})
        if value is not None:
            outputs.append({'data': shown(value), 'execution_count': number, 'metadata': {},
                            'output_type': 'execute_result'})
        yield cell, number, outputs


def run_cell(source, names):
    """Run a cell; return the value of its last statement if it is an expression."""
    tree = ast.parse(source)
    last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
    exec(compile(tree, 'cell', 'exec'), names)
    if last is None:
        return None
    return eval(compile(ast.Expression(last.value), 'cell', 'eval'), names)


def shown(value):
    """Return the representations of a value in a notebook."""
    if hasattr(value, 'savefig'):
        picture = io.BytesIO()
        value.savefig(picture, format='png', dpi=DOTS_PER_INCH, metadata={'Software': None})
        return {'image/png': base64.b64encode(picture.getvalue()).decode(),
                'text/plain': ['a figure']}
    return {'text/plain': repr(value).splitlines(keepends=True)}


def words(outputs):
    """Return the text of outputs, without pictures."""
    return [''.join(item.get('text') or item['data']['text/plain']) for item in outputs]


def main():
    path = path_argument('notebook')
    notebook = json.loads(path.read_text(encoding='utf-8'))
    for cell, number, outputs in run_cells(notebook['cells']):
        cell.update(execution_count=number, outputs=outputs)
    path.write_text(json.dumps(notebook, indent=1, ensure_ascii=False) + '\n', encoding='utf-8')


if __name__ == '__main__':
    main()
